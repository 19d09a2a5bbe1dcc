"""The node on a vehicle: ros2 launch radcam_depth_ros depth.launch.py image:=/front/image_raw ..."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "radcam_depth_ros"

# name: (default, description). What is empty is left to the parameter file.
ARGUMENTS = {
    "params_file": (
        PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "node.yaml"]),
        "Parameter file; config/node.yaml explains every line.",
    ),
    "image": ("", "Topic of the camera's images, such as /front/image_raw."),
    "camera_info": ("", "Topic of the camera's calibration."),
    "radar_topics": ("", "Topics of the radars' point clouds, separated by commas."),
    "image_transport": ("", "raw or compressed."),
    "model_file": ("", "Weight file in place of the one that comes with the package."),
    "device": ("", "cpu, cuda, cuda:1 ..."),
    "autostart": ("", "false leaves configure and activate to a lifecycle manager."),
    "namespace": ("", "Namespace of the node and of its topics: one for each camera."),
    "node_name": ("radcam_depth", "Name of the node."),
    "use_sim_time": ("false", "true to go by /clock, with a bag that is played with --clock."),
    "log_level": ("info", "debug, info, warn, error."),
}


def start(context: LaunchContext) -> list[Node]:
    """Makes the node of the arguments' values."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    parameters = {"use_sim_time": given["use_sim_time"].lower() == "true"}
    for argument, parameter in (
        ("image", "image_topic"),
        ("camera_info", "camera_info_topic"),
        ("image_transport", "image_transport"),
        ("model_file", "model_file"),
        ("device", "device"),
    ):
        if given[argument]:
            parameters[parameter] = given[argument]
    if given["radar_topics"]:
        parameters["radar_topics"] = [topic.strip() for topic in given["radar_topics"].split(",")]
    if given["autostart"]:
        parameters["autostart"] = given["autostart"].lower() == "true"
    node = Node(
        package=PACKAGE,
        executable="radcam_depth_node",
        name=given["node_name"],
        namespace=given["namespace"],
        parameters=[given["params_file"], parameters],
        arguments=["--ros-args", "--log-level", given["log_level"]],
        output="both",
    )
    return [node]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
