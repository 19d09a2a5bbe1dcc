"""One node for each camera, each in its camera's namespace; all take the same radars.

ros2 launch radcam_depth_ros multi_camera.launch.py cameras:=front,left,right radar_topics:=/radar_front/points
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import FindPackageShare

PACKAGE = "radcam_depth_ros"
# Arguments of depth.launch.py that all cameras get alike. name: (default, description).
PASSED_ON = {
    "image": ("image_raw", "Topic of the images, relative to a camera's namespace."),
    "image_transport": ("", "raw, compressed or compressed_topic."),
    "camera_info": ("camera_info", "Topic of the calibration, relative to a camera's namespace."),
    "radar_topics": (
        "/radar/points",
        "Topics of the radars, separated by commas; with a slash they are shared by all.",
    ),
    "footprint_frame": ("", "Frame on the road under the vehicle."),
    "network": ("", "Network whose weights come with the package."),
    "model_file": ("", "Weight file in place of the one that comes with the package."),
    "device": ("", "cpu, cuda, cuda:1 ..."),
    "threads": ("", "CPU threads of each network: the cores divided by the cameras."),
    "use_sim_time": ("false", "true to go by /clock."),
    "log_level": ("info", "debug, info, warn, error."),
    "respawn": ("false", "true to start a node again when it ends."),
}


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Makes one node for each camera."""
    cameras = [name.strip() for name in LaunchConfiguration("cameras").perform(context).split(",") if name.strip()]
    if not cameras:
        raise RuntimeError("expected the cameras' namespaces separated by commas, got none; say cameras:=front,left")
    folder = LaunchConfiguration("params_folder").perform(context)
    source = str(Path(FindPackageShare(PACKAGE).perform(context)) / "launch" / "depth.launch.py")
    nodes: list[LaunchDescriptionEntity] = []
    for camera in cameras:
        own_file = Path(folder) / f"{camera}.yaml" if folder else None
        given = {name: LaunchConfiguration(name).perform(context) for name in PASSED_ON}
        given |= {"namespace": camera, "params_file": str(own_file) if own_file and own_file.is_file() else ""}
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
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in PASSED_ON.items()
            ),
            OpaqueFunction(function=start),
        ]
    )
