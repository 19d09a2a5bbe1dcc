"""Decodes and encodes ROS messages.

Reading takes any object with the ROS attribute names, of rclpy and of rosbags alike; writing goes through a
`MessageFactory`. Neither library is imported.
"""

from __future__ import annotations

from radcam_depth_ros.messages.calibration import Calibration
from radcam_depth_ros.messages.clouds import PointsReading, decode_points
from radcam_depth_ros.messages.compressed_depth import encode_compressed_depth, png_problem
from radcam_depth_ros.messages.encode_clouds import encode_cloud, encode_points
from radcam_depth_ros.messages.encode_images import (
    COLORMAPS,
    DEPTH_ENCODINGS,
    colorise,
    encode_camera_info,
    encode_compressed_image,
    encode_confidence,
    encode_depth,
    encode_image,
    encode_jpeg_file,
    encode_preview,
)
from radcam_depth_ros.messages.images import (
    ClassReading,
    DepthReading,
    ImageReading,
    decode_classes,
    decode_depth,
    decode_image,
)
from radcam_depth_ros.messages.radar import MOST_RETURNS, RadarReading, decode_radar
from radcam_depth_ros.messages.radar_contents import RadarContents
from radcam_depth_ros.messages.radar_fields import DEFAULT_ALIASES, FieldAliases, RadarFields
from radcam_depth_ros.messages.radar_scan import SCAN_FIELDS
from radcam_depth_ros.messages.transforms import (
    OdometryReading,
    StampedTransform,
    decode_odometry,
    decode_transforms,
    encode_odometry,
    encode_transforms,
)
from radcam_depth_ros.messages.wire import MessageError, MessageFactory, stamp_ns

__all__ = [
    "COLORMAPS",
    "DEFAULT_ALIASES",
    "DEPTH_ENCODINGS",
    "MOST_RETURNS",
    "SCAN_FIELDS",
    "Calibration",
    "ClassReading",
    "DepthReading",
    "FieldAliases",
    "ImageReading",
    "MessageError",
    "MessageFactory",
    "OdometryReading",
    "PointsReading",
    "RadarContents",
    "RadarFields",
    "RadarReading",
    "StampedTransform",
    "colorise",
    "decode_classes",
    "decode_depth",
    "decode_image",
    "decode_odometry",
    "decode_points",
    "decode_radar",
    "decode_transforms",
    "encode_camera_info",
    "encode_cloud",
    "encode_compressed_depth",
    "encode_compressed_image",
    "encode_confidence",
    "encode_depth",
    "encode_image",
    "encode_jpeg_file",
    "encode_odometry",
    "encode_points",
    "encode_preview",
    "encode_transforms",
    "png_problem",
    "stamp_ns",
]
