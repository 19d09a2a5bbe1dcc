"""Reads a bag as frames with ground truth: one path for simulated, imported and recorded drives.

Frames come from the same decode and pair as in the live node. Ground truth is the exact depth image of a simulator, the
LiDAR scan nearest to the image, or many scans before and after it. Scans are moved to the image's time where the bag
tells how the vehicle moved.
"""

from radcam_depth_ros.drive.reading import motion_topics, prime, read_samples, remarks
from radcam_depth_ros.drive.sample import Sample
from radcam_depth_ros.drive.scan_use import ScanSummary, ScanUse
from radcam_depth_ros.drive.settings import (
    ACCUMULATIONS,
    GROUND_TRUTHS,
    AccumulationConfig,
    DriveError,
    DriveSettings,
    DriveWarning,
    TopicChoice,
)

__all__ = [
    "ACCUMULATIONS",
    "GROUND_TRUTHS",
    "AccumulationConfig",
    "DriveError",
    "DriveSettings",
    "DriveWarning",
    "Sample",
    "ScanSummary",
    "ScanUse",
    "TopicChoice",
    "motion_topics",
    "prime",
    "read_samples",
    "remarks",
]
