"""The error of this room."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class StorageError(RadcamDepthError):
    """Storage that cannot be reached, read or written."""
