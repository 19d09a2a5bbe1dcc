"""Builds frames from the messages of camera, radars, transforms and odometry."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from radcam_depth_ros.frame import CameraModel, Frame, GroundPlane, RadarReturns, RadcamDepthError
from radcam_depth_ros.frame_builder.settings import TRANSFORM_TOPICS, FrameBuilderConfig, FrameBuilderError
from radcam_depth_ros.frame_builder.transforms import TransformIntake
from radcam_depth_ros.geometry import GeometryError, RigidTransform, TransformTree, ground_plane
from radcam_depth_ros.messages import (
    Calibration,
    ImageReading,
    RadarContents,
    RadarReading,
    decode_image,
    decode_radar,
    decode_transforms,
)
from radcam_depth_ros.motion import Memory, Motion, MotionError, Mounts, displacement, move
from radcam_depth_ros.pairing import Pair, Pairer, PairingCounts, for_each_radar
from radcam_depth_ros.setting import can_adjust, live_settings

_SECOND = 1_000_000_000
_LATE_IMAGE_NS = _SECOND
"""An image may be so much older than one that came out before it."""
_LIVE_MEMORY = Memory(reach_ns=_SECOND // 10, jump_ns=_SECOND // 10, kept=4096)
"""Live, the pose of an image's time comes after the image."""


class FrameBuilder:
    """Takes messages as they come and gives frames.

    Args:
        config: What to read.

    Attributes:
        transforms: The transform tree, filled from `/tf_static` and `/tf`.
        dropped_returns: Of each radar, how many returns of its last sweep were left out since they were not finite.
        thinned_returns: The same of those left out since there were too many.
        unstamped_sweeps: Of each radar, how many sweeps had a stamp of 0.
        unmoved_frames: How many frames have returns that could not be moved to the image's time.
        motion_problem: Why that is so of the last frame; empty where it is not.
        last_motion_problem: Why it was so the last time.
    """

    def __init__(self, config: FrameBuilderConfig) -> None:
        self.config = config
        self.transforms = TransformTree()
        self._mounts = Mounts(self.transforms, _LIVE_MEMORY)
        refuses_jumps = config.static_transform_jumps == "refuse"
        self._transform_intake = TransformIntake(
            self.transforms, self._mounts, refuses_jumps=refuses_jumps, needed=self._needed_frames
        )
        self._sensor_frames: dict[str, str] = {}  # by topic, as the last messages have them
        self._last_sweeps: dict[int, tuple[RadarReading, int]] = {}  # by radar, with its time
        self.dropped_returns = dict.fromkeys(config.radars, 0)
        self.thinned_returns = dict.fromkeys(config.radars, 0)
        self.unstamped_sweeps = dict.fromkeys(config.radars, 0)
        self.contents = {
            topic: RadarContents(names) for topic, names in zip(config.radars, config.field_aliases(), strict=True)
        }
        """What the sweeps of each radar have."""
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

    def adjust(self, config: FrameBuilderConfig) -> None:
        """Takes up a config that differs in live settings, from the next frame on.

        Raises:
            RadcamDepthError: when more differs.
        """
        if not can_adjust(self.config, config):
            names = ", ".join(live_settings(config))
            raise FrameBuilderError(f"only {names} and limits of pairing can change; begin anew")
        self._pairer.adjust(config.pairing)
        self.config = config

    @property
    def camera(self) -> CameraModel | None:
        """The rectified camera; None until camera_info came."""
        return self._calibration.camera if self._calibration else None

    @property
    def odometry_problem(self) -> str:
        """What is wrong with the last odometry, though it could be read; empty where nothing is."""
        return self._motion.frame_problem if self._motion is not None else ""

    @property
    def transform_problem(self) -> str:
        """What `/tf_static` and `/tf` disagree in, or which static transform jumped; empty where nothing did."""
        return self._transform_intake.problem

    @property
    def counts(self) -> PairingCounts:
        """What was paired so far."""
        return self._pairer.counts

    @property
    def offsets_s(self) -> dict[str, tuple[float, ...]]:
        """Of each radar: stamps of the last sweeps that were taken, corrected, minus the images', seconds."""
        return dict(zip(self.config.radars, self._pairer.offsets_s, strict=True))

    @property
    def waits_s(self) -> tuple[float, ...]:
        """How long the last images waited for sweeps, seconds."""
        return self._pairer.waits_s

    def add(self, topic: str, message: Any, now_ns: int, arrived_ns: int | None = None) -> tuple[Frame, ...]:
        """Takes one message.

        Args:
            topic: One of the topics of the config, `/tf_static` or `/tf`; others are ignored.
            message: Of the topic's type, of rclpy or rosbags.
            now_ns: Time of arrival on a clock that never goes back; says how long an image has waited.
            arrived_ns: Time of arrival on the clock that images are stamped by, for `radar_stamps`; None where `now_ns`
                is on that clock, as the times of recording of a bag are.

        Returns:
            Frames that are complete now, in stamp order.

        Raises:
            RadcamDepthError: for a message that cannot be used; it is left out, and nothing else is lost.
        """
        return self.take(topic, self.decode(topic, message), now_ns, arrived_ns)

    def decode(self, topic: str, message: Any) -> Any:
        """What is in a message of a topic: the first part of `add`, which may run in any thread.

        Raises:
            RadcamDepthError: for a message that cannot be used.
        """
        if topic == self.config.image:
            return decode_image(message)
        if topic in self.config.radars:
            return decode_radar(message, self._aliases[topic])
        # Calibration and odometry are small, and read where they are taken.
        return decode_transforms(message) if topic in TRANSFORM_TOPICS else message

    def take(self, topic: str, content: Any, now_ns: int, arrived_ns: int | None = None) -> tuple[Frame, ...]:
        """Takes what `decode` gave: the second part of `add`, with the same result and errors."""
        if topic == self.config.image:
            image: ImageReading = content
            if self.config.camera_frame:
                image = replace(image, frame_id=self.config.camera_frame)
            self._sensor_frames[topic] = image.frame_id
            self._follow(image.frame_id)
            return self._frames(self._pairer.add_image(image.stamp_ns, image, now_ns))
        if topic in self.config.radars:
            sweep: RadarReading = content
            self._sensor_frames[topic] = sweep.frame_id
            self.contents[topic].add(sweep.returns, sweep.fields)
            self.dropped_returns[topic], self.thinned_returns[topic] = sweep.dropped, sweep.thinned
            sweep_ns = self.config.sweep_ns(topic, sweep.stamp_ns, now_ns if arrived_ns is None else arrived_ns)
            self.unstamped_sweeps[topic] += sweep_ns == 0
            return self._frames(self._pairer.add_sweep(topic, sweep_ns, sweep, now_ns))
        if topic == self.config.calibration_topic:
            if self._calibration is None or not self._calibration.matches(content):
                self._calibration = None
                self._calibration = Calibration(content, image_is_rectified=self.config.image_is_rectified)
        elif topic in TRANSFORM_TOPICS:
            is_static = topic == TRANSFORM_TOPICS[0]
            links = self._transform_intake.add(content, is_static=is_static)
            if not is_static and self._motion is not None and not self.config.odometry:
                self._motion.add_links(links)
        elif topic == self.config.odometry and self._motion is not None:
            self._motion.add(content)
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

    def camera_from_radar(
        self,
        index: int,
        radar_frame: str,
        camera_frame: str,
        camera_ns: int | None = None,
        radar_ns: int | None = None,
    ) -> RigidTransform:
        """Where a radar is, from the config or the transform tree.

        Args:
            index: The radar's place in `config.radars`.
            radar_frame: The frame of its clouds; the config's comes first.
            camera_frame: The camera's frame.
            camera_ns: When the camera is there, and
            radar_ns: when the radar was, where a mount moves; None for the newest that is known.

        Raises:
            RadcamDepthError: when nobody tells.
        """
        if self._fixed_extrinsics:
            return self._fixed_extrinsics[index]
        frame = self._radar_frames[index] or radar_frame
        if not frame:
            raise FrameBuilderError(
                f"the clouds on {self.config.radars[index]!r} have an empty frame_id; set it in the driver, or set the "
                "parameter radar_frame"
            )
        if not self.transforms.can_transform(camera_frame, frame) and not self.transforms.frames:
            raise FrameBuilderError(
                f"no transform from {frame!r} to {camera_frame!r}: nothing came on /tf_static; publish it, or set the "
                "parameter camera_from_radar (x y z qx qy qz qw)"
            )
        if camera_ns is None or radar_ns is None:
            return self.transforms.lookup(camera_frame, frame)
        return self._mounts.lookup(camera_frame, camera_ns, frame, radar_ns)

    def _needed_frames(self) -> tuple[str, ...]:
        """The frames that are looked up, as far as they are known."""
        config, motion = self.config, self._motion
        base = motion.base_frame if motion is not None else None
        names = (*self._sensor_frames.values(), config.camera_frame, *self._radar_frames, config.footprint_frame)
        return tuple(name for name in (*names, config.odom_frame if config.moves_radar else "", base or "") if name)

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
                raise FrameBuilderError(str(error)) from error
            self._ready.popleft()
        return tuple(frames)

    def _frame(self, pair: Pair[ImageReading, RadarReading]) -> Frame:
        if self._calibration is None:
            raise FrameBuilderError(
                f"an image came on {self.config.image!r} but no usable camera_info on "
                f"{self.config.calibration_topic!r}; "
                "publish the camera's calibration there, or set the topic's name"
            )
        reading = pair.image
        frame_id = reading.frame_id
        if not frame_id and not self._fixed_extrinsics:
            raise FrameBuilderError(
                f"the images on {self.config.image!r} have an empty frame_id; set it in the driver, or set the "
                "parameter camera_frame"
            )
        self._calibration.check_size(reading.image)
        self.motion_problem = ""
        parts = tuple(self._radar(index, pair, frame_id) for index in range(len(pair.sweeps)))
        if self.motion_problem:
            self.unmoved_frames += 1
            self.last_motion_problem = self.motion_problem
        oldest_s = max(self.config.pairing.max_sweep_age_s, self.config.max_hold_s)
        for poses in (self._mounts, *((self._motion,) if self._motion is not None else ())):
            poses.forget_before(pair.stamp_ns - round(oldest_s * _SECOND) - _LATE_IMAGE_NS)
        return Frame(
            reading.stamp_ns,
            frame_id,
            reading.image,
            self._calibration.camera,
            RadarReturns.concatenate(parts),
            self._ground(frame_id, reading.stamp_ns),
            tuple(len(part) for part in parts),
            self._calibration.lens,
        )

    def _radar(self, index: int, pair: Pair[ImageReading, RadarReading], camera_frame: str) -> RadarReturns:
        """A radar's returns: of the nearest sweep, and of those before it as far as they can be moved."""
        nearest, offset_s = self._nearest(index, pair)
        if nearest is None or offset_s is None:
            return RadarReturns.empty()
        returns = self._in_camera(index, nearest, camera_frame, pair.stamp_ns, offset_s)
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

    def _nearest(self, index: int, pair: Pair[ImageReading, RadarReading]) -> tuple[RadarReading | None, float | None]:
        """A radar's nearest sweep and its offset; where there is none, its last one where that may be held."""
        sweep, offset_s = pair.sweeps[index], pair.offsets_s[index]
        if sweep is not None and offset_s is not None:
            self._last_sweeps[index] = (sweep, pair.stamp_ns + round(offset_s * _SECOND))
        elif self.config.without_radar == "hold" and index in self._last_sweeps:
            held, time_ns = self._last_sweeps[index]
            if 0 <= pair.stamp_ns - time_ns <= self.config.max_hold_s * _SECOND:
                return held, (time_ns - pair.stamp_ns) / _SECOND
        return sweep, offset_s

    def _moved(
        self, index: int, sweep: RadarReading, camera_frame: str, image_ns: int, offset_s: float
    ) -> RadarReturns:
        """A sweep's returns where they are at the image's time."""
        motion = self._motion
        if motion is None:
            raise MotionError("the images have no frame_id that /tf could place")
        sweep_ns, base_frame = image_ns + round(offset_s * _SECOND), motion.base_frame or camera_frame
        # Of /tf the poses are the camera's own, its mount's motion included; odometry's leave that to the mounts.
        seen_ns = sweep_ns if base_frame == camera_frame else image_ns
        returns = self._in_camera(index, sweep, camera_frame, image_ns, offset_s, seen_ns)
        radar_m = self.camera_from_radar(index, sweep.frame_id, camera_frame, seen_ns, sweep_ns).translation
        base_from_camera = self._mounts.lookup(base_frame, image_ns, camera_frame, image_ns)
        how = displacement(motion, base_from_camera, radar_m, sweep_ns, image_ns)
        return move(returns, how, is_over_ground=sweep.is_over_ground)

    def _in_camera(
        self,
        index: int,
        sweep: RadarReading,
        camera_frame: str,
        image_ns: int,
        offset_s: float,
        seen_ns: int | None = None,
    ) -> RadarReturns:
        """A sweep's returns in the camera's axes as these are at the image's time, or at `seen_ns`."""
        returns = sweep.returns
        age_s = np.full(len(returns), -offset_s, np.float32)
        sweep_ns, camera_ns = image_ns + round(offset_s * _SECOND), image_ns if seen_ns is None else seen_ns
        camera_from_radar = self.camera_from_radar(index, sweep.frame_id, camera_frame, camera_ns, sweep_ns)
        return RadarReturns(camera_from_radar.apply(returns.xyz_m), returns.rcs_dbsm, returns.radial_speed_mps, age_s)

    def _ground(self, camera_frame: str, image_ns: int) -> GroundPlane:
        if self.config.camera_height_m > 0:
            return level_ground(self.config.camera_height_m, self.config.camera_pitch_deg, self.config.camera_roll_deg)
        footprint = self.config.footprint_frame
        if camera_frame and footprint and self.transforms.can_transform(camera_frame, footprint):
            return ground_plane(self._mounts.lookup(camera_frame, image_ns, footprint, image_ns))
        return GroundPlane()


def level_ground(height_m: float, pitch_deg: float | None = None, roll_deg: float | None = None) -> GroundPlane:
    """The flat road under a camera at a height, looking down by the pitch and leaning to its right by the roll.

    Where one of both is None it is taken for 0, and the road for assumed.
    """
    pitch, roll = math.radians(pitch_deg or 0.0), math.radians(roll_deg or 0.0)
    return GroundPlane(
        height_m,
        (-math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch), -math.sin(pitch)),
        is_assumed=pitch_deg is None or roll_deg is None,
    )
