"""What a bag holds for the node: rates, contents, frames, clocks, what is missing, and parameters that fit it."""

from radcam_depth_ros.inspection.parameter_file import check_parameters, render_parameters, write_parameters
from radcam_depth_ros.inspection.report import (
    CameraFacts,
    CloudFacts,
    ExtrinsicFacts,
    Finding,
    ImageFacts,
    OffsetFacts,
    Report,
    TopicFacts,
)
from radcam_depth_ros.inspection.suggestion import (
    Setting,
    Suggestion,
    extrinsic_parameters,
    ground_parameters,
    topic_parameters,
)
from radcam_depth_ros.inspection.survey import survey

__all__ = [
    "CameraFacts",
    "CloudFacts",
    "ExtrinsicFacts",
    "Finding",
    "ImageFacts",
    "OffsetFacts",
    "Report",
    "Setting",
    "Suggestion",
    "TopicFacts",
    "check_parameters",
    "extrinsic_parameters",
    "ground_parameters",
    "render_parameters",
    "survey",
    "topic_parameters",
    "write_parameters",
]
