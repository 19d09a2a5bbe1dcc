"""Error class of reports."""

from radcam_depth_ros.frame import RadcamDepthError


class ReportError(RadcamDepthError):
    """A report whose parts do not fit together, or a picture that cannot be encoded."""
