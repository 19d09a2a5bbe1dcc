"""Builds frames from messages: decodes, pairs images with radar sweeps, transforms into the camera's frame."""

from __future__ import annotations

from radcam_depth_ros.frame_builder.builder import FrameBuilder, level_ground
from radcam_depth_ros.frame_builder.settings import (
    COMPRESSED_SUFFIX,
    TRANSFORM_TOPICS,
    WITHOUT_RADAR,
    FrameBuilderConfig,
    FrameBuilderError,
)

__all__ = [
    "COMPRESSED_SUFFIX",
    "TRANSFORM_TOPICS",
    "WITHOUT_RADAR",
    "FrameBuilder",
    "FrameBuilderConfig",
    "FrameBuilderError",
    "level_ground",
]
