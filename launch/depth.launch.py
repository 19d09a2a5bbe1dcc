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
EITHER = ("", "true", "false")


def is_true(text: str) -> bool:
    """Of an argument that is true or false."""
    return text == "true"


def topics(text: str) -> list[str]:
    """Names separated by commas; [""] stands for an empty list, which a parameter file cannot hold."""
    return [name.strip() for name in text.split(",") if name.strip()] or [""]


def numbers(text: str) -> list[float]:
    """Numbers separated by commas or blanks."""
    return [float(number) for number in text.replace(",", " ").split()]


# Arguments that set a parameter. name: (parameter, how the text is read, description). What is left empty is left to
# the parameter files.
SETS: dict[str, tuple[str, Callable[[str], Any], str]] = {
    "image": ("image_topic", str, "Topic of the camera's images, such as /front/image_raw."),
    "image_transport": ("image_transport", str, "raw, compressed or compressed_topic."),
    "camera_info": ("camera_info_topic", str, "Topic of the camera's calibration; camera_info beside image by itself."),
    "radar_topics": ("radar_topics", topics, 'Topics of the radars, separated by commas; "," for none.'),
    "image_is_rectified": ("image_is_rectified", is_true, "true for images without distortion, as image_rect topics."),
    "camera_frame": ("camera_frame", str, "Frame of images whose frame_id is empty."),
    "radar_frame": ("radar_frame", str, "Frame of radar clouds whose frame_id is empty."),
    "camera_from_radar": ("camera_from_radar", numbers, "x y z qx qy qz qw for each radar, in place of /tf_static."),
    "footprint_frame": ("footprint_frame", str, "Frame on the road under the vehicle."),
    "camera_height_m": ("camera_height_m", float, "Height of the camera above the road, in place of footprint_frame."),
    "radar_time_offset_s": ("radar_time_offset_s", float, "Added to the radars' stamps."),
    "depth_encoding": ("depth_encoding", str, "32FC1 (metres) or 16UC1 (millimetres)."),
    "output_size": ("output_size", str, "native or network."),
    "points_stride": ("points_stride", int, "depth/points has a point for each square of so many pixels' width."),
    "without_radar": ("without_radar", str, "Images without radar returns: camera_only, hold or suppress."),
    "network": ("network", str, "Network whose weights come with the package."),
    "model_file": ("model_file", str, "Weight file in place of the one that comes with the package."),
    "device": ("device", str, "cpu, cuda, cuda:1 ..."),
    "threads": ("threads", int, "CPU threads of the network; several nodes should share the cores."),
    "autostart": ("autostart", is_true, "false leaves configure and activate to a lifecycle manager."),
}
# All other arguments. name: (default, description).
OTHERS = {
    "sensors": ("", "Typical sensors: a name of config/sensors, such as ars548_nebula."),
    "params_file": ("", "Parameter file, which outdoes sensors; config/node.yaml explains every line."),
    "namespace": ("", "Namespace of the node and of its topics: one for each camera."),
    "node_name": ("radcam_depth", "Name of the node."),
    "use_sim_time": ("false", "true to go by /clock, with a bag that is played with --clock."),
    "log_level": ("info", "debug, info, warn, error."),
    "respawn": ("false", "true to start the node again when it ends."),
    "rviz": ("false", "true to look at it in RViz."),
}
CHOICES = {
    **dict.fromkeys(("image_is_rectified", "autostart"), EITHER),
    **dict.fromkeys(("use_sim_time", "respawn", "rviz"), EITHER[1:]),
    "image_transport": ("", "raw", "compressed", "compressed_topic"),
    "depth_encoding": ("", "32FC1", "16UC1"),
    "output_size": ("", "native", "network"),
    "without_radar": ("", "camera_only", "hold", "suppress"),
    "log_level": ("debug", "info", "warn", "error", "fatal"),
}
# What rviz/radcam_depth.rviz shows; a node in a namespace has them there.
SHOWN = ("depth/preview", "depth/points", "depth/confidence", "semi_dense/image_rect", "radar/points")


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Makes the nodes of the arguments' values."""
    given = {name: LaunchConfiguration(name).perform(context).strip() for name in (*SETS, *OTHERS)}
    share = Path(FindPackageShare(PACKAGE).perform(context))
    parameters: dict[str, Any] = {"use_sim_time": is_true(given["use_sim_time"])}
    for name, (parameter, read, _) in SETS.items():
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
    described = {name: ("", description) for name, (_, _, description) in SETS.items()} | OTHERS
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description, choices=CHOICES.get(name))
        for name, (default, description) in described.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
