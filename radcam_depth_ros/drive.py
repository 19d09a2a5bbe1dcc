"""A bag as frames with ground truth: one path for simulated, imported and recorded drives.

Frames come from the same decode and pair as in the live node. Ground truth is the exact depth image of a simulator, or
the LiDAR scan nearest to the image.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics, find_topics
from radcam_depth_ros.frame import FloatArray, Frame, ImageArray, RadarReturns, RadcamDepthError
from radcam_depth_ros.geometry import depth_image
from radcam_depth_ros.intake import Intake, IntakeConfig
from radcam_depth_ros.messages import (
    ClassReading,
    DepthReading,
    PointsReading,
    decode_classes,
    decode_depth,
    decode_points,
)
from radcam_depth_ros.pairing import PairingConfig

GROUND_TRUTHS = ("any", "exact", "lidar", "none")


class DriveError(RadcamDepthError):
    """A bag whose messages do not fit together."""


@dataclass(frozen=True)
class DriveSettings:
    """How a bag is read; topics are found by type and name where they are not given.

    Attributes:
        image: Topic of the images.
        camera_info: Topic of the camera's calibration.
        radars: Topics of the radars.
        lidar: Topic of the LiDAR.
        depth: Topic of the exact depth images.
        classes: Topic of the class images.
        ground_truth: `exact` depth images, `lidar`, `any` (exact where there is, else LiDAR), or `none`.
        max_lidar_offset_s: The farthest that a LiDAR scan may lie from its image in time.
        image_is_rectified: As in IntakeConfig.
        camera_from_radar: As in IntakeConfig.
        camera_height_m: As in IntakeConfig.
        camera_pitch_deg: As in IntakeConfig.
        camera_roll_deg: As in IntakeConfig.
        pairing: How images find their radar sweeps.
    """

    image: str | None = None
    camera_info: str | None = None
    radars: tuple[str, ...] | None = None
    lidar: str | None = None
    depth: str | None = None
    classes: str | None = None
    ground_truth: str = "any"
    max_lidar_offset_s: float = 0.06
    image_is_rectified: bool = False
    camera_from_radar: tuple[float, ...] = ()
    camera_height_m: float = 0.0
    camera_pitch_deg: float = 0.0
    camera_roll_deg: float = 0.0
    pairing: PairingConfig = field(default_factory=PairingConfig)

    def __post_init__(self) -> None:
        if self.ground_truth not in GROUND_TRUTHS:
            raise DriveError(f"ground_truth must be one of {', '.join(GROUND_TRUTHS)}, got {self.ground_truth!r}")
        if not self.max_lidar_offset_s >= 0:
            raise DriveError(f"max_lidar_offset_s must not be negative, got {self.max_lidar_offset_s}")

    def topics(self, reader: BagReader) -> SensorTopics:
        """The sensors of a bag; BagError names what it lacks."""
        return find_topics(
            reader.topics,
            image=self.image,
            camera_info=self.camera_info,
            radars=self.radars,
            lidar=self.lidar,
            depth=self.depth,
            classes=self.classes,
        )

    def intake(self, topics: SensorTopics) -> IntakeConfig:
        """How frames are made of these topics."""
        return IntakeConfig(
            image=topics.image,
            camera_info=topics.camera_info,
            radars=topics.radars,
            image_is_rectified=self.image_is_rectified,
            camera_from_radar=self.camera_from_radar,
            camera_height_m=self.camera_height_m,
            camera_pitch_deg=self.camera_pitch_deg,
            camera_roll_deg=self.camera_roll_deg,
            pairing=self.pairing,
        )


@dataclass(frozen=True)
class Sample:
    """A frame and what is known of its true depth.

    Attributes:
        frame: The frame.
        radars: The radars' topics, in the order of `frame.radar_parts`.
        depth_m: (H, W) float32 true depth at the image's size: NaN unknown, +inf sky.
        source: Where it comes from: `exact`, `lidar` or `none`.
        classes: (H, W) uint8 Cityscapes training ids, 255 unknown; None where the bag has none.
    """

    frame: Frame
    radars: tuple[str, ...]
    depth_m: FloatArray
    source: str
    classes: ImageArray | None = None

    @property
    def radar_parts(self) -> tuple[RadarReturns, ...]:
        """The returns of each radar."""
        return self.frame.radar_parts


def prime(reader: BagReader, intake: Intake, topics: SensorTopics) -> None:
    """Gives the intake a bag's transforms and its first camera_info, as a node that was there before would have them.

    A recording may hold an image before the first camera_info; live, that image would be lost.
    """
    if topics.tf_static:
        for message in reader.messages([topics.tf_static]):
            intake.accept("/tf_static", message.message, message.log_time_ns)
    for message in reader.messages([topics.camera_info]):
        intake.accept(message.topic, message.message, message.log_time_ns)
        break


def read_samples(path: Path | str, settings: DriveSettings | None = None) -> Iterator[Sample]:
    """Reads a bag's frames with their ground truth, in order, each image that has one camera_info.

    Args:
        path: A rosbag2 folder or .mcap file.
        settings: How to read it.

    Raises:
        RadcamDepthError: when the bag lacks what a frame needs, or holds a message that cannot be used.
    """
    settings = settings or DriveSettings()
    with BagReader(path) as reader:
        topics = settings.topics(reader)
        intake = Intake(settings.intake(topics))
        prime(reader, intake, topics)
        truth = _GroundTruth(topics, settings, intake)
        waiting: deque[Frame] = deque()
        wanted = {topics.image, topics.camera_info, *topics.radars, *truth.topics}
        for message in reader.messages(wanted):
            now_ns = message.log_time_ns
            truth.accept(message.topic, message.message)
            waiting.extend(intake.expire(now_ns))
            waiting.extend(intake.accept(message.topic, message.message, now_ns))
            while waiting and truth.is_complete(waiting[0], now_ns):
                yield truth.sample(waiting.popleft())
        waiting.extend(intake.flush())
        for frame in waiting:
            yield truth.sample(frame)


class _GroundTruth:
    """Depth images, scans and class images of the last moments, until their frame asks for them."""

    def __init__(self, topics: SensorTopics, settings: DriveSettings, intake: Intake) -> None:
        exact = topics.depth if settings.ground_truth in ("any", "exact") else None
        lidar = topics.lidar if settings.ground_truth in ("any", "lidar") and exact is None else None
        if settings.ground_truth in ("exact", "lidar") and exact is None and lidar is None:
            raise DriveError(
                f"ground_truth {settings.ground_truth!r} needs a topic that this bag does not have; its topics for it: "
                f"depth {topics.depth}, lidar {topics.lidar}"
            )
        self._exact, self._lidar = exact, lidar
        self._classes = topics.classes if settings.ground_truth != "none" else None
        self._radars = topics.radars
        self._intake = intake
        self._max_offset_ns = round(settings.max_lidar_offset_s * 1e9)
        # What comes later than this after its image is not waited for.
        self._patience_ns = self._max_offset_ns + 500_000_000
        self._depths: deque[DepthReading] = deque(maxlen=32)
        self._scans: deque[PointsReading] = deque(maxlen=32)
        self._class_images: deque[ClassReading] = deque(maxlen=32)

    @property
    def topics(self) -> tuple[str, ...]:
        return tuple(topic for topic in (self._exact, self._lidar, self._classes) if topic is not None)

    def accept(self, topic: str, message: object) -> None:
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
        shape = frame.image.shape[:2]
        source, depth_m = "none", np.full(shape, np.nan, np.float32)
        exact = next((reading for reading in self._depths if reading.stamp_ns == frame.stamp_ns), None)
        scan = min(self._scans, key=lambda scan: abs(scan.stamp_ns - frame.stamp_ns), default=None)
        if exact is not None:
            source, depth_m = "exact", exact.depth_m
        elif scan is not None and abs(scan.stamp_ns - frame.stamp_ns) <= self._max_offset_ns:
            camera_from_lidar = self._intake.transforms.lookup(frame.frame_id, scan.frame_id)
            source, depth_m = "lidar", depth_image(camera_from_lidar.apply(scan.xyz_m), frame.camera)
        classes = next((reading.classes for reading in self._class_images if reading.stamp_ns == frame.stamp_ns), None)
        for name, image in (("depth", depth_m), ("class", classes)):
            if image is not None and image.shape != shape:
                raise DriveError(
                    f"the {name} image is {image.shape}, its camera image {shape}; record them at one size"
                )
        return Sample(frame, self._radars, depth_m, source, classes)
