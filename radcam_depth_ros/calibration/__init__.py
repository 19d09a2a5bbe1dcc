"""Whether a bag's extrinsics and clocks are right: pictures, scores against shifted ones, and a verdict."""

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
from radcam_depth_ros.calibration.road import ROAD_FRAMES, RoadReport, RoadValue, check_road

__all__ = [
    "FRAMES",
    "OK",
    "ROAD_FRAMES",
    "SUSPECT",
    "UNKNOWN",
    "CalibrationError",
    "Fit",
    "Report",
    "RoadReport",
    "RoadValue",
    "SensorReport",
    "ShiftFacts",
    "TimeReport",
    "check",
    "check_road",
]
