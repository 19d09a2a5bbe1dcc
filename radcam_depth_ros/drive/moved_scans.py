"""LiDAR scans moved to the time of an image by the vehicle's motion."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from itertools import islice

import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.accumulation import accumulate, without_occluded
from radcam_depth_ros.drive.published import published_depth
from radcam_depth_ros.drive.scan_use import LEFT_OUT, MOVED, ScanUse
from radcam_depth_ros.drive.scans import Scan, ScanWindow
from radcam_depth_ros.drive.settings import DriveError, DriveSettings
from radcam_depth_ros.frame import FloatArray, Frame
from radcam_depth_ros.geometry import RigidTransform, TransformTree, depth_image
from radcam_depth_ros.messages import decode_odometry, decode_transforms
from radcam_depth_ros.motion import Motion, moves

_FIRST_MESSAGES = 10
"""A driver that starts may name another frame at first."""


@dataclass(frozen=True)
class LidarDepth:
    """The depth of an image by LiDAR.

    Attributes:
        use: How the scan nearest to the image was used.
        single_m: (H, W) float32 metres, NaN unknown: the nearest scan; None where it was left out.
        accumulated_m: The same of all scans around it; None where that was not asked for, or cannot be.
    """

    use: ScanUse
    single_m: FloatArray | None = None
    accumulated_m: FloatArray | None = None


def find_motion(reader: BagReader, topics: SensorTopics, transforms: TransformTree, camera_frame: str) -> Motion | None:
    """How the camera moves, still without poses; None of a bag that does not tell.

    Odometry counts before `/tf`.

    Args:
        reader: The bag.
        topics: Its topics.
        transforms: The vehicle's fixed frames.
        camera_frame: The camera's.

    Raises:
        DriveError: for odometry of a frame whose place on the vehicle is not known, where `/tf` does not serve either.
    """
    child = None
    if topics.odometry is not None:
        for message in islice(reader.messages([topics.odometry]), _FIRST_MESSAGES):
            child = decode_odometry(message.message).child_frame_id
            if child and transforms.can_transform(camera_frame, child):
                return Motion(topics.odometry, is_odometry=True, transforms=transforms, anchor=camera_frame)
    for message in reader.messages([topics.tf]) if topics.tf is not None else ():
        if any(moves(transforms, camera_frame, link) for link in decode_transforms(message.message)):
            return Motion(message.topic, is_odometry=False, transforms=transforms, anchor=camera_frame)
    if child is not None:
        raise DriveError(
            f"LiDAR scans cannot be moved to the images' time: expected odometry of a frame that {camera_frame!r} is "
            f"fixed to, got child_frame_id {child!r} on {topics.odometry}; record /tf_static with that frame's place, "
            "or leave the odometry out of the bag, and scans are taken as they lie"
        )
    return None


class MovedScans:
    """Moves scans to the times of one image after another.

    Args:
        reader: The bag, for this alone: it is read ahead of the images.
        lidar: The LiDAR's topic.
        motion: The vehicle's, without poses.
        transforms: The vehicle's fixed frames.
        settings: How.
        many: Accumulate scans, with the nearest one besides; else the nearest alone.
    """

    def __init__(
        self,
        reader: BagReader,
        lidar: str,
        motion: Motion,
        transforms: TransformTree,
        settings: DriveSettings,
        *,
        many: bool,
    ) -> None:
        self._motion, self._transforms, self._many = motion, transforms, many
        self._config = settings.accumulation
        self._max_offset_ns = round(settings.max_lidar_offset_s * 1e9)
        # Its beams alone leave wider gaps than many scans do: 2 degrees of 16 beams are 22 px at a focal length of 630.
        self._single = dataclasses.replace(self._config, occlusion_px=2 * self._config.occlusion_px)
        # The nearest scan is the last one before the image or the first one after it.
        alone = dataclasses.replace(self._config, scans=1, window_s=settings.max_lidar_offset_s)
        window = self._config if many else alone
        self._is_published = settings.is_published
        messages = (
            message
            for message in reader.messages([lidar, motion.topic])
            if message.topic != lidar or settings.screened(lidar, message.message) is not None
        )
        self._window = ScanWindow(messages, lidar, motion, transforms, window)

    def depth(self, frame: Frame, scan_ns: int) -> LidarDepth:
        """The depth of a frame.

        Args:
            frame: The frame.
            scan_ns: The stamp of the scan nearest to it, whether it can be moved or not.

        Raises:
            GeometryError: when the LiDAR's place on the vehicle is not known.
        """
        scans = self._window.around(frame.stamp_ns)
        world_from_camera = self._camera(frame)
        if world_from_camera is None:
            return self._left_out(frame, scan_ns, self._motion.why_unknown(frame.stamp_ns))
        nearest = min(scans, key=lambda scan: abs(scan.stamp_ns - frame.stamp_ns), default=None)
        if nearest is None or abs(nearest.stamp_ns - frame.stamp_ns) > self._max_offset_ns:
            return self._left_out(frame, scan_ns, self._motion.why_unknown(scan_ns))
        moved = (world_from_camera.inverse() @ nearest.world_from_scan).apply(nearest.points_m)
        if self._is_published:
            return LidarDepth(self._moved(frame, nearest), published_depth(moved, frame.camera))
        # The LiDAR sees past things from beside the camera: what shows through their gaps goes.
        single_m = without_occluded(depth_image(moved, frame.camera), frame.camera, self._single)
        many_m = None
        if self._many:
            many_m = accumulate(nearest, scans, world_from_camera, frame.camera, self._config)
        return LidarDepth(self._moved(frame, nearest), single_m, many_m)

    def _camera(self, frame: Frame) -> RigidTransform | None:
        """`world_from_camera` at the frame's time; None where it is not known."""
        pose, base_frame = self._motion.at(frame.stamp_ns), self._motion.base_frame
        if pose is None or base_frame is None or not self._transforms.can_transform(base_frame, frame.frame_id):
            return None
        return pose @ self._transforms.lookup(base_frame, frame.frame_id)

    def _moved(self, frame: Frame, scan: Scan) -> ScanUse:
        poses = [self._motion.at(time_ns) for time_ns in (frame.stamp_ns, scan.stamp_ns)]
        places = [pose.translation for pose in poses if pose is not None]
        shift_m = float(np.linalg.norm(places[1] - places[0])) if len(places) == 2 else np.nan
        return ScanUse(MOVED, (scan.stamp_ns - frame.stamp_ns) / 1e9, shift_m)

    @staticmethod
    def _left_out(frame: Frame, scan_ns: int, reason: str) -> LidarDepth:
        return LidarDepth(ScanUse(LEFT_OUT, (scan_ns - frame.stamp_ns) / 1e9, reason=reason))
