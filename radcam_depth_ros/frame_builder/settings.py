"""What is read, and how frames are made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.messages import FieldAliases
from radcam_depth_ros.pairing import PairingConfig, for_each_radar

TRANSFORM_TOPICS = ("/tf_static", "/tf")
COMPRESSED_SUFFIX = "/compressed"
"""What image_transport adds to a topic's name for compressed images."""
WITHOUT_RADAR = ("camera_only", "hold", "suppress")
"""What becomes of an image without radar returns: depth of the camera alone, of older returns, or none."""


class FrameBuilderError(RadcamDepthError):
    """An image that no frame can be made of, such as for a missing transform, or a setting that does not fit."""


@dataclass(frozen=True)
class FrameBuilderConfig:
    """What is read, and how frames are made of it.

    Attributes:
        image: Topic of the images, sensor_msgs/Image or CompressedImage.
        camera_info: Topic of the camera's calibration; empty for `camera_info` beside the images, as image_transport
            has it.
        radars: Topics of the radars' point clouds; may be empty.
        image_is_rectified: The images are free of distortion, as `image_rect` topics are, whatever camera_info says.
        camera_frame: Frame of the camera where the image's frame_id is empty.
        radar_frame: Frame of the radars where a cloud's frame_id is empty, one for all of them or one for each.
        radar_fields: Names of the clouds' fields where they are not among those that are known, as
            `FieldAliases.parse` reads them; one text for all radars or one for each.
        camera_from_radar: Extrinsics in place of `/tf_static`: x y z in metres and the quaternion x y z w of each
            radar in the camera's optical frame, 7 numbers a radar, in the order of `radars`.
        footprint_frame: Frame on the road under the vehicle (REP 105); gives the camera's height and attitude.
        camera_height_m: Height of the camera above the road, in place of `footprint_frame`; 0 where unknown.
        camera_pitch_deg: With `camera_height_m`: how far the camera looks down, degrees.
        camera_roll_deg: With `camera_height_m`: how far the camera leans to its right, degrees.
        radar_motion_compensation: Returns of a single sweep are moved to the image's time, too; those of several always
            are.
        odometry: Topic of the vehicle's nav_msgs/Odometry, by which returns are moved; empty takes `/tf`.
        odom_frame: Of `/tf`: the frame that stands still.
        without_radar: One of `WITHOUT_RADAR`; with `hold` a radar that has no sweep for an image keeps its last one.
        max_hold_s: With `hold`: no longer than this, in seconds.
        pairing: How images find their radar sweeps.
    """

    image: str = "image"
    camera_info: str = ""
    radars: tuple[str, ...] = ("radar/points",)
    image_is_rectified: bool = False
    camera_frame: str = ""
    radar_frame: str | tuple[str, ...] = ""
    radar_fields: str | tuple[str, ...] = ""
    camera_from_radar: tuple[float, ...] = ()
    footprint_frame: str = "base_footprint"
    camera_height_m: float = 0.0
    camera_pitch_deg: float = 0.0
    camera_roll_deg: float = 0.0
    radar_motion_compensation: bool = False
    odometry: str = ""
    odom_frame: str = "odom"
    without_radar: str = "camera_only"
    max_hold_s: float = 0.5
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
        if self.without_radar not in WITHOUT_RADAR:
            raise FrameBuilderError(
                f"without_radar must be one of {', '.join(WITHOUT_RADAR)}, got {self.without_radar!r}"
            )
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

    def field_aliases(self) -> tuple[FieldAliases, ...]:
        """The names of each radar's fields.

        Raises:
            RadcamDepthError: when `radar_fields` names something else, or is of another number of radars.
        """
        texts = for_each_radar("radar_fields", self.radar_fields, len(self.radars))
        return tuple(FieldAliases.parse(text) for text in texts)
