"""The error of this room."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class FleetError(RadcamDepthError):
    """A run over many drives that cannot begin, go on or be merged."""
