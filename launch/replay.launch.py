"""A recorded drive through the node: ros2 launch radcam_depth_ros replay.launch.py bag:=drive.mcap image:=... ."""

from importlib.util import find_spec

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    TimerAction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.event_handlers import OnStateTransition
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

PACKAGE = "radcam_depth_ros"
ROS2, OWN = "ros2", "radcam-depth"
"""Players: `ros2 bag play`, and the package's own, which needs no rosbag2."""


def player(context: LaunchContext) -> ExecuteProcess:
    """The player with the arguments' values."""
    names = ("player", "bag", "rate", "start_offset", "loop")
    given = {name: LaunchConfiguration(name).perform(context) for name in names}
    if given["player"] == ROS2:
        command, start = ["ros2", "bag", "play"], "--start-offset"
    else:
        command, start = [ExecutableInPackage(package=PACKAGE, executable="radcam-depth"), "play"], "--start"
    command += [given["bag"], "--clock", "--rate", given["rate"], start, given["start_offset"]]
    command += ["--loop"] if given["loop"].lower() == "true" else []
    return ExecuteProcess(cmd=command, output="screen")


def play_when_active(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Plays once the network is loaded: before, the node hears nothing."""
    play = player(context)

    def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        return [] if play.process_details else [play]

    begin = OpaqueFunction(function=start)
    # That the node is active is told once: where it got lost, play nevertheless.
    longest = TimerAction(period=LaunchConfiguration("longest_wait"), actions=[begin], cancel_on_shutdown=True)
    active = OnStateTransition(
        goal_state="active", entities=[LogInfo(msg="the node is active: playing the bag"), begin]
    )
    return [RegisterEventHandler(active), longest]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` asks for."""
    arguments = [
        DeclareLaunchArgument("bag", description="Rosbag2 folder or .mcap file."),
        DeclareLaunchArgument(
            "player",
            default_value=ROS2 if find_spec("ros2bag") else OWN,
            choices=(ROS2, OWN),
            description="ros2 is `ros2 bag play`; radcam-depth the package's own, which needs no rosbag2.",
        ),
        DeclareLaunchArgument("rate", default_value="1.0", description="How fast to play: 0.5 is half as fast."),
        DeclareLaunchArgument(
            "start_offset", default_value="0.0", description="Seconds to leave out at the beginning."
        ),
        DeclareLaunchArgument(
            "loop", default_value="false", choices=("true", "false", "True", "False"), description="Begin anew."
        ),
        DeclareLaunchArgument("longest_wait", default_value="60.0", description="Seconds until it plays in any case."),
    ]
    node = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(PathJoinSubstitution([FindPackageShare(PACKAGE), "launch", "depth.launch.py"])),
        launch_arguments=[("use_sim_time", "true")],  # launch hands all others down to the included file
    )
    return LaunchDescription([*arguments, OpaqueFunction(function=play_when_active), node])
