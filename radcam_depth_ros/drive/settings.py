"""How a bag is read."""

from __future__ import annotations

from dataclasses import dataclass, field

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.bags.topics import SensorTopics, find_topics
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.intake import IntakeConfig
from radcam_depth_ros.pairing import PairingConfig

GROUND_TRUTHS = ("any", "exact", "lidar", "both", "none")
ACCUMULATIONS = ("never", "where_possible", "always")


class DriveError(RadcamDepthError):
    """A bag whose messages do not fit together."""


class DriveWarning(UserWarning):
    """A bag that can be used, but gives less than it might."""


@dataclass(frozen=True)
class AccumulationConfig:
    """How LiDAR scans before and after an image become one denser ground truth (METHODS, d_acc).

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
    """

    scans: int = 80
    window_s: float = 8.0
    window_m: float = 100.0
    tolerance_m: float = 0.3
    tolerance_share: float = 0.02
    occlusion_px: float = 16.0

    def __post_init__(self) -> None:
        if self.scans < 1:
            raise DriveError(f"accumulation.scans must be at least 1, got {self.scans}")
        for name in ("window_s", "window_m", "tolerance_m", "tolerance_share", "occlusion_px"):
            if not getattr(self, name) >= 0:
                raise DriveError(f"accumulation.{name} must not be negative, got {getattr(self, name)}")


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
        odometry: Topic of the vehicle's motion, for moving scans and radar returns; `/tf` serves where there is none.
        ground_truth: `exact` depth images, `lidar`, `both` (exact, and the nearest scan besides), `any` (exact where
            there is, else LiDAR), or `none`.
        accumulate: Whether LiDAR depth is that of many scans, with the nearest one besides: `never`, `where_possible`
            (a bag without the vehicle's motion gives the nearest scan as it lies, with a warning) or `always`. Scans
            are moved to the image's time in any case where the bag tells the vehicle's motion, and left out where it
            does not for their time.
        accumulation: How scans are accumulated.
        max_lidar_offset_s: The farthest that a LiDAR scan may lie from its image in time.
        image_is_rectified: As in IntakeConfig.
        camera_from_radar: As in IntakeConfig.
        camera_height_m: As in IntakeConfig.
        camera_pitch_deg: As in IntakeConfig.
        camera_roll_deg: As in IntakeConfig.
        radar_frame: As in IntakeConfig.
        radar_fields: As in IntakeConfig.
        radar_motion_compensation: As in IntakeConfig.
        odom_frame: As in IntakeConfig.
        without_radar: As in IntakeConfig.
        max_hold_s: As in IntakeConfig.
        pairing: How images find their radar sweeps.
    """

    image: str | None = None
    camera_info: str | None = None
    radars: tuple[str, ...] | None = None
    lidar: str | None = None
    depth: str | None = None
    classes: str | None = None
    odometry: str | None = None
    ground_truth: str = "any"
    accumulate: str = "never"
    accumulation: AccumulationConfig = field(default_factory=AccumulationConfig)
    max_lidar_offset_s: float = 0.06
    image_is_rectified: bool = False
    camera_from_radar: tuple[float, ...] = ()
    camera_height_m: float = 0.0
    camera_pitch_deg: float = 0.0
    camera_roll_deg: float = 0.0
    radar_frame: str | tuple[str, ...] = ""
    radar_fields: str | tuple[str, ...] = ""
    radar_motion_compensation: bool = False
    odom_frame: str = "odom"
    without_radar: str = "camera_only"
    max_hold_s: float = 0.5
    pairing: PairingConfig = field(default_factory=PairingConfig)

    def __post_init__(self) -> None:
        for name, known in (("ground_truth", GROUND_TRUTHS), ("accumulate", ACCUMULATIONS)):
            if getattr(self, name) not in known:
                raise DriveError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
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
            odometry=self.odometry,
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
            radar_frame=self.radar_frame,
            radar_fields=self.radar_fields,
            radar_motion_compensation=self.radar_motion_compensation,
            odometry=topics.odometry or "",
            odom_frame=self.odom_frame,
            without_radar=self.without_radar,
            max_hold_s=self.max_hold_s,
            pairing=self.pairing,
        )
