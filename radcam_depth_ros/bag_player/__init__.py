"""Playing bags over DDS, where rosbag2 is not installed and where the demo has to hold messages back.

This room imports rclpy; nothing but the demo, the room `listening`, and the verb `play` when it runs imports this room.
"""

from radcam_depth_ros.bag_player.playback import Playback, PlaybackError, PlayOptions, Progress, ros_node, why_not
from radcam_depth_ros.bag_player.player import (
    CLOCK_PERIOD_S,
    MAX_LEAD_NS,
    PlayedMessage,
    PlayedTopic,
    Player,
    message_class,
)

__all__ = [
    "CLOCK_PERIOD_S",
    "MAX_LEAD_NS",
    "PlayOptions",
    "Playback",
    "PlaybackError",
    "PlayedMessage",
    "PlayedTopic",
    "Player",
    "Progress",
    "message_class",
    "ros_node",
    "why_not",
]
