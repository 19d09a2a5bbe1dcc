"""Ground truth from LiDAR scans, moved to the images' time where the bag has the vehicle's motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.moved_scans import LidarDepth, MovedScans, find_motion
from radcam_depth_ros.drive.scan_use import AS_IT_LIES, ScanUse
from radcam_depth_ros.drive.settings import DriveError, DriveSettings
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.geometry import GeometryError, TransformTree, depth_image
from radcam_depth_ros.messages import PointsReading, decode_points
from radcam_depth_ros.motion import own_motion

_MOVING_MPS = 1.0
"""Slower by Doppler, a vehicle stands still, or its radar's speeds are over ground: nothing is known of its speed."""


class LidarTruth:
    """Gives the LiDAR's depth of one image after another.

    Args:
        lidar: The LiDAR's topic.
        topics: The bag's.
        settings: How.
        transforms: The vehicle's fixed frames.
        ahead: The bag, for this alone: it is read ahead of the images.
        warn: Told once where scans should be accumulated, and cannot be.
        many: Accumulate scans where that is possible; else the nearest alone is wanted.
    """

    def __init__(
        self,
        lidar: str,
        topics: SensorTopics,
        settings: DriveSettings,
        transforms: TransformTree,
        ahead: BagReader,
        warn: Callable[[str], None],
        *,
        many: bool,
    ) -> None:
        self.topic = lidar
        self._topics, self._settings, self._transforms = topics, settings, transforms
        self._ahead, self._warn, self._many = ahead, warn, many
        self._max_offset_ns = round(settings.max_lidar_offset_s * 1e9)
        self._scans: deque[PointsReading] = deque(maxlen=32)
        self._moved: MovedScans | None = None
        self._is_started = False

    def add(self, message: Any) -> None:
        """Takes a scan."""
        self._scans.append(decode_points(message))

    def is_known(self, stamp_ns: int) -> bool:
        """Whether the scan nearest to an image of this time has come."""
        return any(scan.stamp_ns >= stamp_ns for scan in self._scans)

    def depth(self, frame: Frame) -> LidarDepth | None:
        """The depth of a frame; None where no scan is near enough to it.

        Raises:
            DriveError: where the LiDAR's place is not known, or scans cannot be moved or accumulated though they must.
        """
        nearest = min(self._scans, key=lambda scan: abs(scan.stamp_ns - frame.stamp_ns), default=None)
        if nearest is None or abs(nearest.stamp_ns - frame.stamp_ns) > self._max_offset_ns:
            return None
        if not self._is_started:
            self._start(frame.frame_id)
        try:
            if self._moved is not None:
                return self._moved.depth(frame, nearest.stamp_ns)
            return self._as_it_lies(frame, nearest)
        except GeometryError as error:
            raise DriveError(
                f"the scans on {self.topic} cannot be brought to the camera: {error}; record /tf_static with the "
                "LiDAR's place, or choose ground_truth 'exact' or 'none'"
            ) from None

    def _start(self, camera_frame: str) -> None:
        self._is_started = True
        motion = find_motion(self._ahead, self._topics, self._transforms, camera_frame)
        if motion is not None:
            self._moved = MovedScans(self._ahead, self.topic, motion, self._transforms, self._settings, many=self._many)
        elif self._many or self._settings.is_published:
            lack = (
                "it does not say how the vehicle moved; record odometry (nav_msgs/Odometry), or the link from odom to "
                "the vehicle on /tf"
            )
            if self._settings.accumulate == "always" or self._settings.is_published:
                what = "moved to the images' time" if self._settings.is_published else "accumulated"
                raise DriveError(f"the bag's LiDAR scans cannot be {what}: {lack}")
            self._warn(f"ground truth is the nearest LiDAR scan alone, as it lies at its own time: {lack}")

    def _as_it_lies(self, frame: Frame, scan: PointsReading) -> LidarDepth:
        camera_from_lidar = self._transforms.lookup(frame.frame_id, scan.frame_id)
        offset_s = (scan.stamp_ns - frame.stamp_ns) / 1e9
        use = ScanUse(AS_IT_LIES, offset_s, abs(offset_s) * _speed_mps(frame))
        return LidarDepth(use, depth_image(camera_from_lidar.apply(scan.xyz_m), frame.camera))


def _speed_mps(frame: Frame) -> float:
    """The vehicle's speed by the radars' Doppler; NaN where that does not tell it."""
    # Around the camera, not around each radar: a metre beside what is tens of metres away.
    found = [own_motion(part.xyz_m, part.radial_speed_mps) for part in frame.radar_parts]
    best = max((own for own in found if own is not None), key=lambda own: own.share, default=None)
    return best.speed_mps if best is not None and best.speed_mps >= _MOVING_MPS else np.nan
