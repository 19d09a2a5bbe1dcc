"""The error of data sets."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class DatasetError(RadcamDepthError):
    """A data set, a scene or a file of it that cannot be read; the message says which, why and what to do."""
