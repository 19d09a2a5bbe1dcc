"""Inspects a bag for the node: rates, contents, frames, clocks, missing inputs, and fitting parameters."""

from radcam_depth_ros.inspection.report import CameraFacts, CloudFacts, Report, TopicFacts
from radcam_depth_ros.inspection.suggestion import (
    Setting,
    Suggestion,
    check_parameters,
    extrinsic_parameters,
    ground_parameters,
    topic_parameters,
    write_parameters,
)
from radcam_depth_ros.inspection.survey import survey

__all__ = [
    "CameraFacts",
    "CloudFacts",
    "Report",
    "Setting",
    "Suggestion",
    "TopicFacts",
    "check_parameters",
    "extrinsic_parameters",
    "ground_parameters",
    "survey",
    "topic_parameters",
    "write_parameters",
]
