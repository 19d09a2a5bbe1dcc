"""Checks a bag's extrinsics and clocks: pictures, scores against other poses, and a verdict."""

from radcam_depth_ros.calibration.check import FRAMES, check
from radcam_depth_ros.calibration.recording import CalibrationError
from radcam_depth_ros.calibration.report import (
    OK,
    SUSPECT,
    UNKNOWN,
    Fit,
    Report,
    SensorReport,
    ShiftFacts,
    TimeReport,
)

__all__ = [
    "FRAMES",
    "OK",
    "SUSPECT",
    "UNKNOWN",
    "CalibrationError",
    "Fit",
    "Report",
    "SensorReport",
    "ShiftFacts",
    "TimeReport",
    "check",
]
