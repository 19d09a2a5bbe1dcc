"""Bags: reading, writing and building messages without ROS, and finding the sensors among the topics."""

from radcam_depth_ros.bags.definitions import MOST_SCAN_BYTES, RADAR_SCAN, deserialise, prepare
from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.headers import Header, header_stamp_ns, read_header
from radcam_depth_ros.bags.message_factory import RosbagsFactory, factory
from radcam_depth_ros.bags.reader import BagMessage, BagReader, TopicInfo
from radcam_depth_ros.bags.scenario import SCENARIO_TOPIC, read_key_frames, read_scenario
from radcam_depth_ros.bags.search import find_bags
from radcam_depth_ros.bags.topics import RADAR_TYPES, SensorTopics, find_topics
from radcam_depth_ros.bags.transforms import read_static_transforms
from radcam_depth_ros.bags.writer import BagWriter

__all__ = [
    "MOST_SCAN_BYTES",
    "RADAR_SCAN",
    "RADAR_TYPES",
    "SCENARIO_TOPIC",
    "BagError",
    "BagMessage",
    "BagReader",
    "BagWriter",
    "Header",
    "RosbagsFactory",
    "SensorTopics",
    "TopicInfo",
    "deserialise",
    "factory",
    "find_bags",
    "find_topics",
    "header_stamp_ns",
    "prepare",
    "read_header",
    "read_key_frames",
    "read_scenario",
    "read_static_transforms",
]
