"""One node for each camera, each in its camera's namespace; all take the same radars.

ros2 launch radcam_depth_ros multi_camera.launch.py cameras:=front,left,right radar_topics:=/radar_front/points
"""

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity, Substitution
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import FindPackageShare

PACKAGE = "radcam_depth_ros"


def first_of(*names: str, default: str) -> list[Substitution]:
    """The first of several arguments that is given, else a default."""
    value: Any = default
    for name in reversed(names):
        value = [LaunchConfiguration(name, default=value)]
    return list(value)


# Arguments of depth.launch.py that all cameras get alike; launch hands down its others as well, where they are given.
# name: (default, its parameter, or a description).
PASSED_ON: dict[str, tuple[str | list[Substitution], str]] = {
    "image": (first_of("image_topic", "input/image", default="image_raw"), "image_topic"),
    "image_transport": ("", "image_transport"),
    "camera_info": (first_of("camera_info_topic", "input/camera_info", default="camera_info"), "camera_info_topic"),
    "radar_topics": (first_of("input/radar", default="/radar/points"), "radar_topics"),
    "footprint_frame": ("", "footprint_frame"),
    "network": ("", "network"),
    "model_file": ("", "model_file"),
    "device": ("", "device"),
    "threads": ("", "threads"),
    "use_sim_time": ("", "true to go by /clock; empty leaves it to SetParameter or the parameter files."),
    "log_level": ("info", "debug, info, warn, error."),
    "respawn": ("false", "true to start a node again when it ends."),
    "params_file": (
        first_of("param_file", default=""),
        "Parameter file of the cameras that have none in params_folder.",
    ),
    "namespace": ("", "Namespace above those of the cameras."),
}
NOTES = {
    "image": " Here it is relative to a camera's namespace.",
    "camera_info": " Here it is relative to a camera's namespace.",
    "radar_topics": " Separated by commas; with a slash they are shared by all cameras.",
    "threads": " Here of each network: the cores divided by the cameras.",
}
# Parameters, by scripts/generate_pages.py:
HELP = {
    "image_topic": "Topic of the camera's images, relative to the node's namespace; remapping works too.",
    "image_transport": "Type of the images.",
    "camera_info_topic": "Topic of the camera's calibration (sensor_msgs/CameraInfo).",
    "radar_topics": "Topics of the radars: sensor_msgs/PointCloud2 or radar_msgs/RadarScan, by the "
    "type that each topic has.",
    "footprint_frame": "Frame on the road under the vehicle (REP 105).",
    "network": "Network whose weights come with the package.",
    "model_file": "Weight file in place of the network's own.",
    "device": "Device that runs the network: cpu, cuda, cuda:1 and so on.",
    "threads": "CPU threads of the network.",
}
# End.


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Makes one node for each camera."""
    cameras = [name.strip() for name in LaunchConfiguration("cameras").perform(context).split(",") if name.strip()]
    if not cameras:
        raise RuntimeError("expected the cameras' namespaces separated by commas, got none; say cameras:=front,left")
    folder, common_file, above = (
        LaunchConfiguration(name).perform(context) for name in ("params_folder", "params_file", "namespace")
    )
    source = str(Path(FindPackageShare(PACKAGE).perform(context)) / "launch" / "depth.launch.py")
    nodes: list[LaunchDescriptionEntity] = []
    for camera in cameras:
        own_file = Path(folder) / f"{camera}.yaml"
        given = {
            "namespace": f"{above}/{camera}" if above else camera,
            "params_file": str(own_file) if folder and own_file.is_file() else common_file,
        }
        include = IncludeLaunchDescription(PythonLaunchDescriptionSource(source), launch_arguments=given.items())
        nodes.append(GroupAction([include]))  # which keeps one camera's arguments from the next one
    return nodes


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("cameras", description="The cameras' namespaces, separated by commas."),
            DeclareLaunchArgument(
                "params_folder",
                default_value="",
                description="Folder with a parameter file for cameras: <camera>.yaml.",
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value=default, description=HELP.get(meaning, meaning) + NOTES.get(name, "")
                )
                for name, (default, meaning) in PASSED_ON.items()
            ),
            OpaqueFunction(function=start),
        ]
    )
