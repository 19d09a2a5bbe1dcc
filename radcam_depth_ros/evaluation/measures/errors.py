"""The error of this room and of `evaluation`."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class EvaluationError(RadcamDepthError):
    """An evaluation that cannot be made: nothing to measure, or images that do not fit together."""
