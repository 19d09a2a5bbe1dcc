"""Settings of the frame builder: topics, frames, extrinsics, the camera above the road."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.messages import FieldAliases
from radcam_depth_ros.pairing import PairingConfig, for_each_radar
from radcam_depth_ros.setting import check_choices, setting

TRANSFORM_TOPICS = ("/tf_static", "/tf")
COMPRESSED_SUFFIX = "/compressed"
"""What image_transport adds to a topic's name for compressed images."""
JUMPS = ("follow", "refuse")
RADAR_STAMPS = ("header", "arrival")
WITHOUT_RADAR = ("camera_only", "hold", "suppress")
"""What becomes of an image without radar returns: depth of the camera alone, of older returns, or none."""


class FrameBuilderError(RadcamDepthError):
    """An image that no frame can be made of, such as for a missing transform, or a setting that does not fit."""


@dataclass(frozen=True)
class FrameBuilderConfig:
    """What is read, and how frames are made of it; descriptions name fields by their parameters (`image_topic`)."""

    image: str = setting(
        "image", "Topic of the camera's images, relative to the node's namespace; remapping works too."
    )
    camera_info: str = setting(
        "",
        "Topic of the camera's calibration (sensor_msgs/CameraInfo). Empty means camera_info beside the images, as "
        "image_transport has it: /front/camera_info for /front/image_raw.",
    )
    radars: tuple[str, ...] = setting(
        ("radar/points",),
        "Topics of the radars: sensor_msgs/PointCloud2 or radar_msgs/RadarScan, by the type that each topic has. "
        '[""] means none: depth comes from the camera alone. '
        "radar_fields, radar_frame, radar_stamps and radar_time_offset_s take one value for all radars, or a list with "
        "one value for each, in this order.",
    )
    image_is_rectified: bool = setting(
        False,
        "Whether the images are free of distortion already, as image_rect topics are. Otherwise the node rectifies "
        "them.",
    )
    camera_frame: str = setting(
        "",
        "Frame of the images, in place of their frame_id. Empty takes the frame_id. Its axes are those of an optical "
        "frame: x right, y down, z forward (REP 103).",
    )
    radar_frame: str | tuple[str, ...] = setting(
        "",
        "Frame of the radar clouds, in place of their frame_id, for drivers that leave it empty or give all radars the "
        "same. Empty takes the frame_id. One frame for all radars, or a list with one for each of radar_topics: "
        'radar_front, or [radar_front, ""].',
    )
    radar_stamps: str | tuple[str, ...] = setting(
        "header",
        "Time of a radar sweep: that in its header, or that of its arrival, for drivers that set no stamps or have "
        "another clock. Arrival is later than the measurement by the driver's delay, which radar_time_offset_s "
        "corrects; in a bag it is the time of recording. One for all radars, or a list with one for each of "
        "radar_topics.",
        choices=RADAR_STAMPS,
    )
    radar_fields: str | tuple[str, ...] = setting(
        "",
        "Names of the radar clouds' fields, where the node does not know them: quantity=field, separated by blanks, "
        "such as rcs=power radial_speed=v_d. Quantities are x y z, range azimuth elevation, rcs, radial_speed "
        "(positive moves away), velocity_x velocity_y velocity_z (relative), compensated_x compensated_y (over "
        "ground). quantity= ignores it. A unit stands behind the field, azimuth=az[deg]: m cm mm km, rad deg mrad, m/s "
        "cm/s km/h; a minus turns the sign, radial_speed=v[-m/s]. One text for all radars, or a list with one for each "
        "of radar_topics.",
    )
    camera_from_radar: tuple[float, ...] = setting(
        (),
        "Poses of the radars in the camera's optical frame, in place of /tf_static: x y z in metres and the quaternion "
        "qx qy qz qw, 7 numbers for each of radar_topics. Empty reads /tf_static, which needs tf2_msgs. A radar 0.5 m "
        "below the camera that looks the same way is [0.0, 0.5, 0.0, 0.5, -0.5, 0.5, 0.5].",
    )
    footprint_frame: str = setting(
        "base_footprint",
        "Frame on the road under the vehicle (REP 105). /tf_static gives the camera's height and attitude above it, "
        "which help the network; the frame may be missing.",
    )
    static_transform_jumps: str = setting(
        "follow",
        "Handling of a transform on /tf_static that comes again, 0.1 m or 1 degree off or more. Diagnostics "
        "tell it either way. follow: the new one counts. refuse: the first one counts, until the node is activated "
        "again.",
        choices=JUMPS,
    )
    camera_height_m: float = setting(
        0.0,
        "Height of the camera above the road in metres, in place of footprint_frame. 0 means unknown: a level camera "
        "at 1.4 m is then assumed, which the network corrects by what it sees.",
        0.0,
        20.0,
        live=True,
    )
    camera_pitch_deg: float | None = setting(
        None,
        "Downward pitch of the camera in degrees, with camera_height_m. Unset, 0 is assumed, which the network "
        "corrects by what it sees.",
        -90.0,
        90.0,
        live=True,
    )
    camera_roll_deg: float | None = setting(
        None,
        "Roll of the camera to its right in degrees, with camera_height_m. Unset, 0 is assumed, which the network "
        "corrects by what it sees.",
        -180.0,
        180.0,
        live=True,
    )
    radar_motion_compensation: bool = setting(
        False,
        "Whether a single sweep is moved to the image's time as well, as several always are. The shipped networks "
        "learned from single sweeps that are not moved.",
    )
    odometry: str = setting(
        "",
        "Topic of the vehicle's motion (nav_msgs/Odometry), needed where radar returns are moved. Its clock is the "
        "camera's, its child_frame_id is in the tree of /tf_static. Empty takes /tf.",
    )
    odom_frame: str = setting(
        "odom", "World-fixed frame in which /tf places the vehicle (REP 105), without odometry_topic."
    )
    without_radar: str = setting(
        "camera_only",
        "Handling of images without radar returns. camera_only: depth from the camera alone, which is less exact. "
        "hold: each radar without a sweep for the image keeps its last one, with its true age, for max_hold_s. "
        "suppress: no depth, as long as no return is in view of the camera.",
        choices=WITHOUT_RADAR,
        live=True,
    )
    max_hold_s: float = setting(
        0.5, "Longest time that a sweep is held, in seconds, with without_radar hold.", 0.0, 10.0, live=True
    )
    pairing: PairingConfig = field(default_factory=PairingConfig)

    def __post_init__(self) -> None:
        expected = 7 * len(self.radars)
        if self.camera_from_radar and len(self.camera_from_radar) != expected:
            raise FrameBuilderError(
                f"camera_from_radar needs x y z qx qy qz qw for each of {len(self.radars)} radars, {expected} numbers, "
                f"got {len(self.camera_from_radar)}"
            )
        if not 0 <= self.camera_height_m < math.inf:
            raise FrameBuilderError(f"camera_height_m must be 0 (unknown) or positive, got {self.camera_height_m}")
        check_choices(self, FrameBuilderError)
        if self.without_radar == "suppress" and not self.radars:
            raise FrameBuilderError(
                "without_radar is suppress but no radar is read, so no depth would ever come out; name the radars, or "
                "set without_radar to camera_only"
            )
        if not 0 <= self.max_hold_s < math.inf:
            raise FrameBuilderError(f"max_hold_s must be 0 or a positive number of seconds, got {self.max_hold_s}")
        topics = (self.image, self.calibration_topic, *self.radars, *((self.odometry,) if self.odometry else ()))
        if len(set(topics)) != len(topics):
            raise FrameBuilderError(
                f"image, camera_info, the radars and odometry must be different topics, got {', '.join(topics)}"
            )
        for_each_radar("radar_time_offset_s", self.pairing.radar_time_offset_s, len(self.radars))
        for_each_radar("radar_frame", self.radar_frame, len(self.radars))
        for_each_radar("radar_stamps", self.radar_stamps, len(self.radars))
        self.field_aliases()

    @property
    def calibration_topic(self) -> str:
        """The topic of the camera's calibration: the one that is named, or the one beside the images."""
        if self.camera_info:
            return self.camera_info
        place, slash, _ = self.image.removesuffix(COMPRESSED_SUFFIX).rpartition("/")
        return f"{place}{slash}camera_info"

    @property
    def moves_radar(self) -> bool:
        """Whether returns are moved to the image's time, for which the vehicle's motion must be known."""
        return bool(self.radars) and (self.radar_motion_compensation or self.pairing.radar_sweeps > 1)

    @property
    def needs_transforms(self) -> bool:
        """Whether `/tf_static` or `/tf` must tell where the radars are."""
        return bool(self.radars) and not self.camera_from_radar

    def sweep_ns(self, topic: str, header_ns: int, arrived_ns: int) -> int:
        """The time of a sweep, nanoseconds, as `radar_stamps` says.

        Args:
            topic: One of `radars`.
            header_ns: The stamp of its header.
            arrived_ns: When it came, on the clock that the images are stamped by.
        """
        return arrived_ns if self.is_stamped_by_arrival(topic) else header_ns

    def is_stamped_by_arrival(self, topic: str) -> bool:
        """Whether the sweeps of one of `radars` are stamped by when they come."""
        return (
            for_each_radar("radar_stamps", self.radar_stamps, len(self.radars))[self.radars.index(topic)] == "arrival"
        )

    def field_aliases(self) -> tuple[FieldAliases, ...]:
        """The names of each radar's fields.

        Raises:
            RadcamDepthError: when `radar_fields` names something else, or is of another number of radars.
        """
        texts = for_each_radar("radar_fields", self.radar_fields, len(self.radars))
        return tuple(FieldAliases.parse(text) for text in texts)
