"""What is known of the true depth of a bag's images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.accumulation import Accumulator, LidarDepth
from radcam_depth_ros.drive.sample import Sample
from radcam_depth_ros.drive.settings import DriveError, DriveSettings
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.geometry import GeometryError, TransformTree, depth_image
from radcam_depth_ros.messages import (
    ClassReading,
    DepthReading,
    PointsReading,
    decode_classes,
    decode_depth,
    decode_points,
)


class GroundTruth:
    """Depth images, scans and class images of the last moments, until their frame asks for them.

    Args:
        topics: The bag's.
        settings: What is wanted.
        transforms: The vehicle's fixed frames.
        accumulator: For depth of many scans; asked only where that is wanted.
        tell: Told once of what the bag lacks for it.

    Raises:
        DriveError: when the bag lacks what the settings ask for.
    """

    def __init__(
        self,
        topics: SensorTopics,
        settings: DriveSettings,
        transforms: TransformTree,
        accumulator: Accumulator,
        tell: Callable[[str], None],
    ) -> None:
        wanted = settings.ground_truth
        self._exact = topics.depth if wanted in ("any", "exact", "both") else None
        self._lidar = topics.lidar if wanted in ("lidar", "both") or (wanted == "any" and not self._exact) else None
        lacking = (wanted in ("exact", "both") and not self._exact) or (wanted in ("lidar", "both") and not self._lidar)
        if lacking:
            raise DriveError(
                f"ground_truth {wanted!r} needs a topic that this bag does not have; its topics for it: depth "
                f"{topics.depth}, lidar {topics.lidar}; record them, name them, or choose another ground_truth"
            )
        self._classes = topics.classes if wanted != "none" else None
        self._radars = topics.radars
        self._settings, self._transforms, self._tell = settings, transforms, tell
        self._accumulator = accumulator if self._lidar and settings.accumulate != "never" else None
        self._max_offset_ns = round(settings.max_lidar_offset_s * 1e9)
        # What comes later than this after its image is not waited for.
        self._patience_ns = self._max_offset_ns + 500_000_000
        self._depths: deque[DepthReading] = deque(maxlen=32)
        self._scans: deque[PointsReading] = deque(maxlen=32)
        self._class_images: deque[ClassReading] = deque(maxlen=32)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics to read."""
        return tuple(topic for topic in (self._exact, self._lidar, self._classes) if topic is not None)

    @property
    def depth_topic(self) -> str | None:
        """Where the depth comes from."""
        return self._exact or self._lidar

    def accept(self, topic: str, message: Any) -> None:
        """Takes a message; those of other topics are ignored."""
        if topic == self._exact:
            self._depths.append(decode_depth(message))
        elif topic == self._lidar:
            self._scans.append(decode_points(message))
        elif topic == self._classes:
            self._class_images.append(decode_classes(message))

    def is_complete(self, frame: Frame, now_ns: int) -> bool:
        """Whether nothing more can come for a frame."""
        stamp = frame.stamp_ns
        if now_ns - stamp > self._patience_ns:
            return True
        depth_known = self._exact is None or any(reading.stamp_ns == stamp for reading in self._depths)
        classes_known = self._classes is None or any(reading.stamp_ns == stamp for reading in self._class_images)
        lidar_known = self._lidar is None or any(scan.stamp_ns >= stamp for scan in self._scans)
        return depth_known and classes_known and lidar_known

    def sample(self, frame: Frame) -> Sample:
        """A frame with what is known of it.

        Raises:
            DriveError: for images of different sizes, a LiDAR whose place is not known, or where scans cannot be
                accumulated though they must.
        """
        shape = frame.image.shape[:2]
        exact = next((reading.depth_m for reading in self._depths if reading.stamp_ns == frame.stamp_ns), None)
        classes = next((reading.classes for reading in self._class_images if reading.stamp_ns == frame.stamp_ns), None)
        for name, image in (("depth", exact), ("class", classes)):
            if image is not None and image.shape != shape:
                raise DriveError(
                    f"the {name} image is {image.shape}, its camera image {shape}; record them at one size"
                )
        lidar = self._lidar_depth(frame)
        single_m = lidar.single_m if lidar else None
        if exact is not None:
            return Sample(frame, self._radars, exact, "exact", classes, single_m)
        if lidar is None or self._exact is not None:
            return Sample(frame, self._radars, np.full(shape, np.nan, np.float32), "none", classes)
        if lidar.accumulated_m is None:
            return Sample(frame, self._radars, lidar.single_m, "lidar", classes)
        return Sample(frame, self._radars, lidar.accumulated_m, "lidar", classes, single_m)

    def _lidar_depth(self, frame: Frame) -> LidarDepth | None:
        if self._lidar is None:
            return None
        if self._accumulator is not None:
            try:
                moved = self._accumulator.depth(frame, self._max_offset_ns, single=self._exact is not None)
            except (DriveError, GeometryError) as error:
                self._give_up_accumulating(str(error))
            else:
                if moved is not None:
                    return moved
        return self._nearest(frame)

    def _give_up_accumulating(self, reason: str) -> None:
        if self._settings.accumulate == "always":
            raise DriveError(f"the bag's LiDAR scans cannot be accumulated: {reason}")
        self._tell(f"ground truth is the nearest LiDAR scan alone, since scans cannot be accumulated: {reason}")
        self._accumulator = None

    def _nearest(self, frame: Frame) -> LidarDepth | None:
        scan = min(self._scans, key=lambda scan: abs(scan.stamp_ns - frame.stamp_ns), default=None)
        if scan is None or abs(scan.stamp_ns - frame.stamp_ns) > self._max_offset_ns:
            return None
        try:
            camera_from_lidar = self._transforms.lookup(frame.frame_id, scan.frame_id)
        except GeometryError as error:
            raise DriveError(
                f"the scans on {self._lidar} cannot be brought to the camera: {error}; record /tf_static with the "
                "LiDAR's place, or choose ground_truth 'exact' or 'none'"
            ) from None
        return LidarDepth(depth_image(camera_from_lidar.apply(scan.xyz_m), frame.camera), None)
