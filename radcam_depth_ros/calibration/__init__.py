"""Checks a bag's extrinsics and clocks: pictures, scores against other poses, and a verdict."""

from radcam_depth_ros.calibration.check import check
from radcam_depth_ros.calibration.report import SUSPECT, Report, SensorReport, TimeReport

__all__ = ["SUSPECT", "Report", "SensorReport", "TimeReport", "check"]
