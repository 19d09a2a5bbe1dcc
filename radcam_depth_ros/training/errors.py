"""The error of training."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class TrainingError(RadcamDepthError):
    """Training data, a run folder or a recipe that cannot be used, or training that went astray."""
