"""A recorded drive through the node: ros2 launch radcam_depth_ros replay.launch.py bag:=drive.mcap image:=... ."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, TimerAction
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "radcam_depth_ros"
# Arguments of depth.launch.py that a replay passes on, with their defaults there.
PASSED_ON = {
    "params_file": PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "node.yaml"]),
    "image": "",
    "camera_info": "",
    "radar_topics": "",
    "image_transport": "",
    "model_file": "",
    "device": "",
    "log_level": "info",
}


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    share = FindPackageShare(PACKAGE)
    arguments = [
        DeclareLaunchArgument("bag", description="Rosbag2 folder or .mcap file."),
        DeclareLaunchArgument("rate", default_value="1.0", description="How fast to play: 0.5 is half as fast."),
        DeclareLaunchArgument("start_delay", default_value="10.0", description="Seconds for the network to load."),
        DeclareLaunchArgument("rviz", default_value="false", description="true to look at it in RViz."),
        *(DeclareLaunchArgument(name, default_value=default) for name, default in PASSED_ON.items()),
    ]
    node = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(PathJoinSubstitution([share, "launch", "depth.launch.py"])),
        launch_arguments={
            "use_sim_time": "true",
            **{name: LaunchConfiguration(name) for name in PASSED_ON},
        }.items(),
    )
    play = ExecuteProcess(
        cmd=["ros2", "bag", "play", LaunchConfiguration("bag"), "--clock", "--rate", LaunchConfiguration("rate")],
        output="screen",
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", PathJoinSubstitution([share, "rviz", "radcam_depth.rviz"])],
        parameters=[{"use_sim_time": True}],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    # The player has no way to wait for the node, which hears nothing before its network is loaded.
    return LaunchDescription(
        [*arguments, node, rviz, TimerAction(period=LaunchConfiguration("start_delay"), actions=[play])]
    )
