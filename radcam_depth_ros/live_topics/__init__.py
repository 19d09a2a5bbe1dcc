"""Hearing topics over DDS as a bag is read.

This room imports rclpy; nothing but the verb `view`, when it shows live topics, imports this room.
"""

from radcam_depth_ros.live_topics.listener import Heard, Listener, ListenOptions, listener

__all__ = ["Heard", "ListenOptions", "Listener", "listener"]
