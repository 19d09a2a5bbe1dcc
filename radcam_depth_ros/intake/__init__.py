"""Messages -> Frame: decodes what comes, pairs images with radar sweeps, and brings all into the camera's frame."""

from __future__ import annotations

from radcam_depth_ros.intake.intake import Intake, level_ground
from radcam_depth_ros.intake.settings import (
    COMPRESSED_SUFFIX,
    TRANSFORM_TOPICS,
    WITHOUT_RADAR,
    IntakeConfig,
    IntakeError,
)

__all__ = [
    "COMPRESSED_SUFFIX",
    "TRANSFORM_TOPICS",
    "WITHOUT_RADAR",
    "Intake",
    "IntakeConfig",
    "IntakeError",
    "level_ground",
]
