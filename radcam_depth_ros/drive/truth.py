"""Ground truth of a bag's images: exact depth images, LiDAR scans, or both."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.lidar_truth import LidarTruth
from radcam_depth_ros.drive.sample import Sample
from radcam_depth_ros.drive.settings import DriveError, DriveSettings
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.messages import ClassReading, DepthReading, decode_classes, decode_depth


class GroundTruth:
    """Depth images, scans and class images of the last moments, until their frame asks for them.

    Args:
        topics: The bag's.
        settings: What is wanted.
        transforms: The vehicle's fixed frames.
        ahead: The bag, for this alone: scans and poses are read ahead of the images.
        warn: Told once of what the bag lacks for it.

    Raises:
        DriveError: when the bag lacks what the settings ask for.
    """

    def __init__(
        self,
        topics: SensorTopics,
        settings: DriveSettings,
        transforms: TransformTree,
        ahead: BagReader,
        warn: Callable[[str], None],
    ) -> None:
        wanted = settings.ground_truth
        self._exact = topics.depth if wanted in ("any", "exact", "both") else None
        lidar = topics.lidar if wanted in ("lidar", "both") or (wanted == "any" and not self._exact) else None
        lacking = (wanted in ("exact", "both") and not self._exact) or (wanted in ("lidar", "both") and not lidar)
        if lacking:
            raise DriveError(
                f"ground_truth {wanted!r} needs a topic that this bag does not have; its topics for it: depth "
                f"{topics.depth}, lidar {topics.lidar}; record them, name them, or choose another ground_truth"
            )
        self._classes = topics.classes if wanted != "none" else None
        self._radars = topics.radars
        # Beside exact depth the nearest scan alone is wanted.
        many = settings.accumulate != "never" and self._exact is None
        self._lidar = LidarTruth(lidar, topics, settings, transforms, ahead, warn, many=many) if lidar else None
        # What comes later than this after its image is not waited for.
        self._patience_ns = round(settings.max_lidar_offset_s * 1e9) + 500_000_000
        self._depths: deque[DepthReading] = deque(maxlen=32)
        self._class_images: deque[ClassReading] = deque(maxlen=32)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics to read."""
        lidar = self._lidar.topic if self._lidar else None
        return tuple(topic for topic in (self._exact, lidar, self._classes) if topic is not None)

    @property
    def depth_topic(self) -> str | None:
        """Where the depth comes from."""
        return self._exact or (self._lidar.topic if self._lidar else None)

    def add(self, topic: str, message: Any) -> None:
        """Takes a message; those of other topics are ignored."""
        if topic == self._exact:
            self._depths.append(decode_depth(message))
        elif self._lidar is not None and topic == self._lidar.topic:
            self._lidar.add(message)
        elif topic == self._classes:
            self._class_images.append(decode_classes(message))

    def is_complete(self, frame: Frame, now_ns: int) -> bool:
        """Whether nothing more can come for a frame."""
        stamp = frame.stamp_ns
        if now_ns - stamp > self._patience_ns:
            return True
        depth_known = self._exact is None or any(reading.stamp_ns == stamp for reading in self._depths)
        classes_known = self._classes is None or any(reading.stamp_ns == stamp for reading in self._class_images)
        lidar_known = self._lidar is None or self._lidar.is_known(stamp)
        return depth_known and classes_known and lidar_known

    def sample(self, frame: Frame) -> Sample:
        """A frame with what is known of it.

        Raises:
            DriveError: for images of different sizes, a LiDAR whose place is not known, or where scans cannot be moved
                or accumulated though they must.
        """
        shape = frame.image.shape[:2]
        exact = next((reading.depth_m for reading in self._depths if reading.stamp_ns == frame.stamp_ns), None)
        classes = next((reading.classes for reading in self._class_images if reading.stamp_ns == frame.stamp_ns), None)
        for name, image in (("depth", exact), ("class", classes)):
            if image is not None and image.shape != shape:
                raise DriveError(
                    f"the {name} image is {image.shape}, its camera image {shape}; record them at one size"
                )
        lidar = self._lidar.depth(frame) if self._lidar else None
        single_m, many_m, scan = (lidar.single_m, lidar.accumulated_m, lidar.use) if lidar else (None, None, None)
        if exact is not None:
            return Sample(frame, self._radars, exact, "exact", classes, single_m, scan)
        if single_m is None or self._exact is not None:
            return Sample(frame, self._radars, np.full(shape, np.nan, np.float32), "none", classes, scan=scan)
        if many_m is None:
            return Sample(frame, self._radars, single_m, "lidar", classes, scan=scan)
        return Sample(frame, self._radars, many_m, "lidar", classes, single_m, scan)
