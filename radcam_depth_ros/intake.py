"""Messages -> Frame: decodes what comes, pairs images with radar sweeps, and brings all into the camera's frame."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from radcam_depth_ros.frame import CameraModel, Frame, GroundPlane, RadarReturns, RadcamDepthError
from radcam_depth_ros.geometry import GeometryError, RigidTransform, TransformTree, ground_plane
from radcam_depth_ros.messages import (
    Calibration,
    FieldAliases,
    ImageReading,
    RadarReading,
    decode_image,
    decode_radar,
    decode_transforms,
)
from radcam_depth_ros.motion import Memory, Motion, MotionError, displacement, move
from radcam_depth_ros.pairing import Pair, Pairer, PairingConfig, PairingCounts, for_each_radar

TRANSFORM_TOPICS = ("/tf_static", "/tf")
_SECOND = 1_000_000_000
_LATE_IMAGE_NS = _SECOND
"""An image may be so much older than one that came out before it."""
_LIVE_MEMORY = Memory(reach_ns=_SECOND // 10, jump_ns=_SECOND // 10, kept=4096)
"""Live, the pose of an image's time comes after the image."""


class IntakeError(RadcamDepthError):
    """An image that no frame can be made of, such as for a missing transform, or a setting that does not fit."""


@dataclass(frozen=True)
class IntakeConfig:
    """What is read, and how frames are made of it.

    Attributes:
        image: Topic of the images, sensor_msgs/Image or CompressedImage.
        camera_info: Topic of the camera's calibration.
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
        pairing: How images find their radar sweeps.
    """

    image: str = "image"
    camera_info: str = "camera_info"
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
    pairing: PairingConfig = field(default_factory=PairingConfig)

    def __post_init__(self) -> None:
        expected = 7 * len(self.radars)
        if self.camera_from_radar and len(self.camera_from_radar) != expected:
            raise IntakeError(
                f"camera_from_radar needs x y z qx qy qz qw for each of {len(self.radars)} radars, {expected} numbers, "
                f"got {len(self.camera_from_radar)}"
            )
        if not 0 <= self.camera_height_m < math.inf:
            raise IntakeError(f"camera_height_m must be 0 (unknown) or positive, got {self.camera_height_m}")
        topics = (self.image, self.camera_info, *self.radars, *((self.odometry,) if self.odometry else ()))
        if len(set(topics)) != len(topics):
            raise IntakeError(
                f"image, camera_info, the radars and odometry must be different topics, got {', '.join(topics)}"
            )
        for_each_radar("radar_time_offset_s", self.pairing.radar_time_offset_s, len(self.radars))
        for_each_radar("radar_frame", self.radar_frame, len(self.radars))
        self.field_aliases()

    @property
    def moves_radar(self) -> bool:
        """Whether returns are moved to the image's time, for which the vehicle's motion must be known."""
        return bool(self.radars) and (self.radar_motion_compensation or self.pairing.radar_sweeps > 1)

    def field_aliases(self) -> tuple[FieldAliases, ...]:
        """The names of each radar's fields.

        Raises:
            RadcamDepthError: when `radar_fields` names something else, or is of another number of radars.
        """
        texts = for_each_radar("radar_fields", self.radar_fields, len(self.radars))
        return tuple(FieldAliases.parse(text) for text in texts)


class Intake:
    """Takes messages as they come and gives frames.

    Args:
        config: What to read.

    Attributes:
        transforms: The transform tree, filled from `/tf_static` and `/tf`.
        dropped_returns: Of each radar, how many returns of its last sweep were left out since they were not finite.
        unmoved_frames: How many frames have returns that could not be moved to the image's time.
        motion_problem: Why that is so of the last frame; empty where it is not.
        last_motion_problem: Why it was so the last time.
    """

    def __init__(self, config: IntakeConfig) -> None:
        self.config = config
        self.transforms = TransformTree()
        self.dropped_returns = dict.fromkeys(config.radars, 0)
        self.unmoved_frames = 0
        self.motion_problem = self.last_motion_problem = ""
        self._motion = self._new_motion("") if config.moves_radar and config.odometry else None
        self._calibration: Calibration | None = None
        self._pairer: Pairer[ImageReading, RadarReading] = Pairer(config.radars, config.pairing)
        self._resets = 0
        self._ready: deque[Pair[ImageReading, RadarReading]] = deque()
        self._aliases = dict(zip(config.radars, config.field_aliases(), strict=True))
        self._radar_frames = for_each_radar("radar_frame", config.radar_frame, len(config.radars))
        self._fixed_extrinsics = tuple(
            RigidTransform.from_quaternion(values[:3], values[3:])
            for values in np.reshape(config.camera_from_radar, (-1, 7))
        )

    @property
    def camera(self) -> CameraModel | None:
        """The rectified camera; None until camera_info came."""
        return self._calibration.camera if self._calibration else None

    @property
    def counts(self) -> PairingCounts:
        """What was paired so far."""
        return self._pairer.counts

    @property
    def offsets_s(self) -> dict[str, tuple[float, ...]]:
        """Of each radar: stamps of the last sweeps that were taken, corrected, minus the images', seconds."""
        return dict(zip(self.config.radars, self._pairer.offsets_s, strict=True))

    def accept(self, topic: str, message: Any, now_ns: int) -> tuple[Frame, ...]:
        """Takes one message.

        Args:
            topic: One of the topics of the config, `/tf_static` or `/tf`; others are ignored.
            message: Of the topic's type, of rclpy or rosbags.
            now_ns: Time of arrival on a clock that never goes back; says how long an image has waited.

        Returns:
            Frames that are complete now, in stamp order.

        Raises:
            RadcamDepthError: for a message that cannot be used; it is left out, and nothing else is lost.
        """
        if topic == self.config.image:
            image = decode_image(message)
            self._follow(image.frame_id or self.config.camera_frame)
            return self._frames(self._pairer.add_image(image.stamp_ns, image, now_ns))
        if topic in self.config.radars:
            sweep = decode_radar(message, self._aliases[topic])
            self.dropped_returns[topic] = sweep.dropped
            return self._frames(self._pairer.add_sweep(topic, sweep.stamp_ns, sweep, now_ns))
        if topic == self.config.camera_info:
            if self._calibration is None or not self._calibration.matches(message):
                self._calibration = None
                self._calibration = Calibration(message, image_is_rectified=self.config.image_is_rectified)
        elif topic in TRANSFORM_TOPICS:
            links = decode_transforms(message)
            for link in links:
                self.transforms.set(link.parent_frame, link.child_frame, link.parent_from_child)
            if topic == TRANSFORM_TOPICS[1] and self._motion is not None and not self.config.odometry:
                self._motion.accept_links(links)
        elif topic == self.config.odometry and self._motion is not None:
            self._motion.accept(message)
        return ()

    def expire(self, now_ns: int) -> tuple[Frame, ...]:
        """Frames whose images have waited for a radar sweep long enough."""
        return self._frames(self._pairer.expire(now_ns))

    def flush(self) -> tuple[Frame, ...]:
        """Frames of all images that still wait, at the end of a bag."""
        self._ready.extend(self._pairer.flush())
        frames = tuple(self._frame(pair) for pair in self._ready)
        self._ready.clear()
        return frames

    def _new_motion(self, camera_frame: str) -> Motion:
        config = self.config
        return Motion(
            config.odometry or TRANSFORM_TOPICS[1],
            is_odometry=bool(config.odometry),
            transforms=self.transforms,
            anchor=camera_frame,
            odom_frame="" if config.odometry else config.odom_frame,
            memory=_LIVE_MEMORY,
        )

    def _follow(self, camera_frame: str) -> None:
        """Begins to note how /tf moves a camera."""
        is_wanted = self.config.moves_radar and not self.config.odometry and bool(camera_frame)
        if is_wanted and (self._motion is None or self._motion.anchor != camera_frame):
            self._motion = self._new_motion(camera_frame)

    def _frames(self, pairs: tuple[Pair[ImageReading, RadarReading], ...]) -> tuple[Frame, ...]:
        # Several pairs come out together when an image had to wait. One that cannot be used must neither take those
        # before it along nor go away in silence: it stays, and its error is raised by the next call.
        self._ready.extend(pairs)
        if self._motion is not None and self._pairer.resets != self._resets:
            # What was before the jump may be another drive.
            self._resets = self._pairer.resets
            self._motion.clear()
        frames: list[Frame] = []
        while self._ready:
            try:
                frames.append(self._frame(self._ready[0]))
            except RadcamDepthError as error:
                if frames:
                    break
                self._ready.popleft()
                # Of one type, so that the caller can tell it from an error in the message that completed the frame.
                raise IntakeError(str(error)) from error
            self._ready.popleft()
        return tuple(frames)

    def _frame(self, pair: Pair[ImageReading, RadarReading]) -> Frame:
        if self._calibration is None:
            raise IntakeError(
                f"an image came on {self.config.image!r} but no usable camera_info on {self.config.camera_info!r}; "
                "publish the camera's calibration there, or set the topic's name"
            )
        reading = pair.image
        frame_id = reading.frame_id or self.config.camera_frame
        if not frame_id and not self._fixed_extrinsics:
            raise IntakeError(
                f"the images on {self.config.image!r} have an empty frame_id; set it in the driver, or set the "
                "parameter camera_frame"
            )
        self._calibration.check_size(reading.image)
        self.motion_problem = ""
        parts = tuple(self._radar(index, pair, frame_id) for index in range(len(pair.sweeps)))
        if self.motion_problem:
            self.unmoved_frames += 1
            self.last_motion_problem = self.motion_problem
        if self._motion is not None:
            self._motion.forget_before(
                pair.stamp_ns - round(self.config.pairing.max_sweep_age_s * _SECOND) - _LATE_IMAGE_NS
            )
        return Frame(
            reading.stamp_ns,
            frame_id,
            reading.image,
            self._calibration.camera,
            RadarReturns.concatenate(parts),
            self._ground(frame_id),
            tuple(len(part) for part in parts),
            self._calibration.lens,
        )

    def _radar(self, index: int, pair: Pair[ImageReading, RadarReading], camera_frame: str) -> RadarReturns:
        """A radar's returns: of the nearest sweep, and of those before it as far as they can be moved."""
        nearest, offset_s = pair.sweeps[index], pair.offsets_s[index]
        if nearest is None or offset_s is None:
            return RadarReturns.empty()
        returns = self._in_camera(index, nearest, camera_frame, offset_s)
        if not self.config.moves_radar:
            return returns
        earlier = pair.earlier[index] if pair.earlier else ()
        sweeps = ((nearest, offset_s), *((item.sweep, item.offset_s) for item in earlier))
        parts: list[RadarReturns] = []
        try:
            for sweep, sweep_offset_s in sweeps:
                parts.append(self._moved(index, sweep, camera_frame, pair.stamp_ns, sweep_offset_s))
        except (MotionError, GeometryError) as error:
            self.motion_problem = (
                f"radar returns cannot be moved to an image's time, so sweeps before the nearest are left out: {error}"
                "; publish odometry and set odometry_topic, or publish /tf and set odom_frame"
            )
        return RadarReturns.concatenate(tuple(parts)) if parts else returns

    def _moved(
        self, index: int, sweep: RadarReading, camera_frame: str, image_ns: int, offset_s: float
    ) -> RadarReturns:
        """A sweep's returns where they are at the image's time."""
        motion = self._motion
        if motion is None:
            raise MotionError("the images have no frame_id that /tf could place")
        returns = self._in_camera(index, sweep, camera_frame, offset_s)
        radar_m = self._camera_from_radar(index, sweep.frame_id, camera_frame).translation
        base_from_camera = self.transforms.lookup(motion.base_frame or camera_frame, camera_frame)
        sweep_ns = image_ns + round(offset_s * _SECOND)
        how = displacement(motion, base_from_camera, radar_m, sweep_ns, image_ns)
        return move(returns, how, is_over_ground=sweep.is_over_ground)

    def _in_camera(self, index: int, sweep: RadarReading, camera_frame: str, offset_s: float) -> RadarReturns:
        returns = sweep.returns
        age_s = np.full(len(returns), -offset_s, np.float32)
        camera_from_radar = self._camera_from_radar(index, sweep.frame_id, camera_frame)
        return RadarReturns(camera_from_radar.apply(returns.xyz_m), returns.rcs_dbsm, returns.radial_speed_mps, age_s)

    def _camera_from_radar(self, index: int, radar_frame: str, camera_frame: str) -> RigidTransform:
        if self._fixed_extrinsics:
            return self._fixed_extrinsics[index]
        frame = radar_frame or self._radar_frames[index]
        if not frame:
            raise IntakeError(
                f"the clouds on {self.config.radars[index]!r} have an empty frame_id; set it in the driver, or set the "
                "parameter radar_frame"
            )
        if not self.transforms.can_transform(camera_frame, frame) and not self.transforms.frames:
            raise IntakeError(
                f"no transform from {frame!r} to {camera_frame!r}: nothing came on /tf_static; publish it, or set the "
                "parameter camera_from_radar (x y z qx qy qz qw)"
            )
        return self.transforms.lookup(camera_frame, frame)

    def _ground(self, camera_frame: str) -> GroundPlane:
        if self.config.camera_height_m > 0:
            return level_ground(self.config.camera_height_m, self.config.camera_pitch_deg, self.config.camera_roll_deg)
        footprint = self.config.footprint_frame
        if camera_frame and footprint and self.transforms.can_transform(camera_frame, footprint):
            return ground_plane(self.transforms.lookup(camera_frame, footprint))
        return GroundPlane()


def level_ground(height_m: float, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> GroundPlane:
    """The flat road under a camera at a height, looking down by the pitch and leaning to its right by the roll."""
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    return GroundPlane(
        height_m,
        (-math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch), -math.sin(pitch)),
    )
