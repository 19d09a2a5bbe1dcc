"""Checks a bag's extrinsics and clocks: pictures, scores against other poses, and a verdict."""

from radcam_depth_ros.calibration.check import FRAMES, check
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN, Report, SensorReport, TimeReport
from radcam_depth_ros.calibration.road import ROAD_FRAMES, RoadReport, check_road

__all__ = [
    "FRAMES",
    "OK",
    "ROAD_FRAMES",
    "SUSPECT",
    "UNKNOWN",
    "Report",
    "RoadReport",
    "SensorReport",
    "TimeReport",
    "check",
    "check_road",
]
