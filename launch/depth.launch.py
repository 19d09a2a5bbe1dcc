"""The node on a vehicle: ros2 launch radcam_depth_ros depth.launch.py image:=/front/image_raw ..."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "radcam_depth_ros"


def is_true(text: str) -> bool:
    """Of an argument that is true or false."""
    return text == "true"


def topics(text: str) -> list[str]:
    """Names separated by commas; [""] stands for an empty list, which a parameter file cannot hold."""
    return [name.strip() for name in text.split(",") if name.strip()] or [""]


def numbers(text: str) -> list[float]:
    """Numbers separated by commas or blanks."""
    return [float(number) for number in text.replace(",", " ").split()]


# Arguments that set a parameter. name: (parameter, how the text is read). Empty leaves it to the parameter files.
SETS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "image": ("image_topic", str),
    "image_transport": ("image_transport", str),
    "camera_info": ("camera_info_topic", str),
    "radar_topics": ("radar_topics", topics),
    "image_is_rectified": ("image_is_rectified", is_true),
    "camera_frame": ("camera_frame", str),
    "radar_frame": ("radar_frame", str),
    "camera_from_radar": ("camera_from_radar", numbers),
    "footprint_frame": ("footprint_frame", str),
    "camera_height_m": ("camera_height_m", float),
    "radar_time_offset_s": ("radar_time_offset_s", float),
    "depth_encoding": ("depth_encoding", str),
    "output_size": ("output_size", str),
    "points_stride": ("points_stride", int),
    "without_radar": ("without_radar", str),
    "network": ("network", str),
    "model_file": ("model_file", str),
    "device": ("device", str),
    "threads": ("threads", int),
    "autostart": ("autostart", is_true),
}
FORMATS: dict[Callable[[str], Any], str] = {
    topics: ' Separated by commas; "," for none.',
    numbers: " Separated by commas or blanks.",
}
# All other arguments. name: (default, description).
OTHERS = {
    "sensors": ("", "Typical sensors: a name of config/sensors, such as ars548_nebula."),
    "params_file": ("", "Parameter file, which wins over sensors; config/node_all.yaml explains every line."),
    "namespace": ("", "Namespace of the node and of its topics: one for each camera."),
    "node_name": ("radcam_depth", "Name of the node."),
    "use_sim_time": ("false", "true to go by /clock, with a bag that is played with --clock."),
    "log_level": ("info", "debug, info, warn, error."),
    "respawn": ("false", "true to start the node again when it ends."),
    "rviz": ("false", "true to look at it in RViz."),
}
OTHER_CHOICES = {
    **dict.fromkeys(("use_sim_time", "respawn", "rviz"), ("true", "false")),
    "log_level": ("debug", "info", "warn", "error", "fatal"),
}
# Parameters, by scripts/generate_pages.py:
HELP = {
    "autostart": "Whether the node configures and activates itself at start.",
    "image_topic": "Topic of the camera's images, relative to the node's namespace; remapping works too.",
    "image_transport": "Type of the images.",
    "camera_info_topic": "Topic of the camera's calibration (sensor_msgs/CameraInfo).",
    "radar_topics": "Topics of the radars (sensor_msgs/PointCloud2).",
    "image_is_rectified": "Whether the images are free of distortion already, as image_rect topics are.",
    "camera_frame": "Frame of images whose frame_id is empty.",
    "radar_frame": "Frame of radar clouds whose frame_id is empty.",
    "camera_from_radar": "Poses of the radars in the camera's optical frame, in place of /tf_static: x y z "
    "in metres and the quaternion qx qy qz qw, 7 numbers for each of radar_topics.",
    "footprint_frame": "Frame on the road under the vehicle (REP 105).",
    "camera_height_m": "Height of the camera above the road in metres, in place of footprint_frame.",
    "radar_time_offset_s": "Correction added to the radars' stamps, in seconds, where their clock or delay "
    "differs from the camera's.",
    "without_radar": "Handling of images without radar returns.",
    "depth_encoding": "Encoding of depth images (REP 118).",
    "points_stride": "Pixel step of depth/points: 1 makes a point of each pixel, 4 of a sixteenth of them.",
    "output_size": "Size of the depth images.",
    "network": "Network whose weights come with the package.",
    "model_file": "Weight file in place of the network's own.",
    "device": "Device that runs the network: cpu, cuda, cuda:1 and so on.",
    "threads": "CPU threads of the network.",
}
CHOICES = {
    "autostart": ("", "true", "false"),
    "image_transport": ("", "raw", "compressed", "compressed_topic"),
    "image_is_rectified": ("", "true", "false"),
    "without_radar": ("", "camera_only", "hold", "suppress"),
    "depth_encoding": ("", "32FC1", "16UC1"),
    "output_size": ("", "native", "network"),
}
# End.
# What rviz/radcam_depth.rviz shows; a node in a namespace has them there.
SHOWN = ("depth/preview", "depth/points", "depth/confidence", "semi_dense/image_rect", "radar/points")


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Makes the nodes of the arguments' values."""
    given = {name: LaunchConfiguration(name).perform(context).strip() for name in (*SETS, *OTHERS)}
    share = Path(FindPackageShare(PACKAGE).perform(context))
    parameters: dict[str, Any] = {"use_sim_time": is_true(given["use_sim_time"])}
    for name, (parameter, read) in SETS.items():
        if given[name]:
            parameters[parameter] = read(given[name])
    files = [given["params_file"]] if given["params_file"] else []
    if given["sensors"]:
        files.insert(0, str(share / "config" / "sensors" / f"{given['sensors']}.yaml"))
    for file in files:
        if not Path(file).is_file():  # or launch would say that it waits for parameters, and the node would not start
            known = ", ".join(sorted(path.stem for path in (share / "config" / "sensors").glob("*.yaml")))
            raise RuntimeError(f"expected a parameter file, got {file}; sensors can be {known}")
    node = LifecycleNode(
        package=PACKAGE,
        executable="radcam_depth_node",
        name=given["node_name"],
        namespace=given["namespace"],
        parameters=[*files, parameters],
        arguments=["--ros-args", "--log-level", given["log_level"]],
        respawn=is_true(given["respawn"]),
        respawn_delay=2.0,
        output="both",
    )
    namespace = given["namespace"].strip("/")
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(share / "rviz" / "radcam_depth.rviz")],
        parameters=[{"use_sim_time": is_true(given["use_sim_time"])}],
        remappings=[(f"/{topic}", f"/{namespace}/{topic}") for topic in SHOWN] if namespace else None,
    )
    return [node, rviz] if is_true(given["rviz"]) else [node]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value="",
            description=HELP[parameter] + FORMATS.get(read, ""),
            choices=CHOICES.get(parameter),
        )
        for name, (parameter, read) in SETS.items()
    ]
    arguments += [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=OTHER_CHOICES.get(name))
        for name, (default, description) in OTHERS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
