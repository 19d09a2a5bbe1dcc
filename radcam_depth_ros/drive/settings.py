"""Settings for reading a bag: topics, ground truth, accumulation of scans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from radcam_depth_ros.bags import BagReader, TopicInfo
from radcam_depth_ros.bags.topics import IMAGE_TYPES, SensorTopics, find_topics
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilderConfig

GROUND_TRUTHS = ("any", "exact", "lidar", "both", "none")
ACCUMULATIONS = ("never", "where_possible", "always")


class DriveError(RadcamDepthError):
    """A bag whose messages do not fit together."""


class DriveWarning(UserWarning):
    """A bag that can be used, but gives less than it might."""


@dataclass(frozen=True)
class AccumulationConfig:
    """How LiDAR scans before and after an image become one denser ground truth (d_acc).

    Attributes:
        scans: At most so many before the image, and so many after it.
        window_s: None is farther away from the image in time.
        window_m: None was taken farther away from where the image was taken.
        tolerance_m: A point and what a scan saw in its direction are the same thing when their distances from the
            sensor differ by less than this
        tolerance_share: plus this share of the distance.
        occlusion_px: A pixel is seen through the gaps of something nearer when this many pixels above and below, or
            half as many left and right, there are clearly nearer ones; at a focal length of 630 px. Of a single scan,
            whose beams lie further apart, twice as many.
        outlier_kernel_px: As published truth for training on nuScenes has it [Singh2023], a pixel of many scans goes
            where another one is nearer by `outlier_m` in a square of this width around it; 0 for no such filter.
        outlier_m: See there.
        interpolate: As there, depth between the pixels that are left is interpolated, linearly over a Delaunay
            triangulation.
    """

    scans: int = 80
    window_s: float = 8.0
    window_m: float = 100.0
    tolerance_m: float = 0.3
    tolerance_share: float = 0.02
    occlusion_px: float = 16.0
    outlier_kernel_px: int = 0
    outlier_m: float = 1.5
    interpolate: bool = False

    def __post_init__(self) -> None:
        if self.scans < 1:
            raise DriveError(f"accumulation.scans must be at least 1, got {self.scans}")
        if self.outlier_kernel_px < 0 or (self.outlier_kernel_px and self.outlier_kernel_px % 2 == 0):
            raise DriveError(f"accumulation.outlier_kernel_px must be odd, or 0, got {self.outlier_kernel_px}")
        for name in ("window_s", "window_m", "tolerance_m", "tolerance_share", "occlusion_px", "outlier_m"):
            if not getattr(self, name) >= 0:
                raise DriveError(f"accumulation.{name} must not be negative, got {getattr(self, name)}")


@dataclass(frozen=True)
class TopicChoice:
    """The topics of a bag that are asked for; those that are None are found by type and name.

    Attributes:
        image: Topic of the images.
        camera_info: Topic of the camera's calibration.
        radars: Topics of the radars; empty for none at all.
        lidar: Topic of the LiDAR.
        depth: Topic of the exact depth images.
        classes: Topic of the class images.
        odometry: Topic of the vehicle's motion, for moving scans and radar returns. `/tf` serves where
            there is none; where it is empty, `/tf` moves the radar returns though there is one.
        preferred: Of images and radars that are None: these are taken where the bag has them.
        is_compressed: The images are sensor_msgs/CompressedImage.
    """

    image: str | None = None
    camera_info: str | None = None
    radars: tuple[str, ...] | None = None
    lidar: str | None = None
    depth: str | None = None
    classes: str | None = None
    odometry: str | None = None
    preferred: tuple[str, ...] = ()
    is_compressed: bool = False

    def find(self, topics: Iterable[TopicInfo], of: str = "the bag") -> SensorTopics:
        """The sensors among some topics.

        Args:
            topics: `BagReader.topics`.
            of: What has them, for the sentence on what it lacks.

        Raises:
            BagError: when there is no camera, camera_info or radar, or not what is asked for.
        """
        return find_topics(
            topics,
            image=self.image,
            camera_info=self.camera_info,
            radars=self.radars,
            lidar=self.lidar,
            depth=self.depth,
            classes=self.classes,
            odometry=self.odometry or None,
            preferred=self.preferred,
            image_types=IMAGE_TYPES[1:] if self.is_compressed else IMAGE_TYPES,
            of=of,
        )


@dataclass(frozen=True)
class DriveSettings:
    """How a bag is read.

    Attributes:
        frame_builder: How frames are made, as in the node. Its topics stand for those that are found: they say for how
            many radars a list has a value each.
        topics: Which topics are read.
        ground_truth: `exact` depth images, `lidar`, `both` (exact, and the nearest scan besides), `any` (exact where
            there is, else LiDAR), or `none`.
        accumulate: Whether LiDAR depth is that of many scans, with the nearest one besides: `never`, `where_possible`
            (a bag without the vehicle's motion gives the nearest scan as it lies, with a warning) or `always`. Where
            the bag tells the vehicle's motion, scans are moved to the image's time in any case; those that cannot be
            moved are left out.
        accumulation: How scans are accumulated.
        max_lidar_offset_s: The farthest that a LiDAR scan may lie from its image in time.
    """

    frame_builder: FrameBuilderConfig = field(default_factory=FrameBuilderConfig)
    topics: TopicChoice = field(default_factory=TopicChoice)
    ground_truth: str = "any"
    accumulate: str = "never"
    accumulation: AccumulationConfig = field(default_factory=AccumulationConfig)
    max_lidar_offset_s: float = 0.06

    def __post_init__(self) -> None:
        for name, known in (("ground_truth", GROUND_TRUTHS), ("accumulate", ACCUMULATIONS)):
            if getattr(self, name) not in known:
                raise DriveError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if not self.max_lidar_offset_s >= 0:
            raise DriveError(f"max_lidar_offset_s must not be negative, got {self.max_lidar_offset_s}")

    @property
    def is_published(self) -> bool:
        """Whether LiDAR depth is that of one moved scan as published evaluations draw it, see `published_depth`."""
        return False

    def screened(self, topic: str, message: Any) -> Any:
        """What is read in place of a message of images, radars or LiDAR; None leaves it out."""
        return message

    def find_topics(self, reader: BagReader) -> SensorTopics:
        """The sensors of a bag; BagError names what it lacks."""
        return self.topics.find(reader.topics)

    def frame_builder_of(self, topics: SensorTopics) -> FrameBuilderConfig:
        """How frames are made of these topics."""
        return replace(
            self.frame_builder,
            image=topics.image,
            camera_info=topics.camera_info,
            radars=topics.radars,
            odometry="" if self.topics.odometry == "" else topics.odometry or "",
        )
