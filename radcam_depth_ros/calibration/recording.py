"""Reads the parts of a bag that its calibration is checked by."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagMessage, BagReader, header_stamp_ns
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.calibration.image_motion import ImageMotion
from radcam_depth_ros.calibration.placements import Pose
from radcam_depth_ros.calibration.signals import Signal
from radcam_depth_ros.drive import DriveSettings, prime
from radcam_depth_ros.frame import FloatArray, Frame, RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.geometry import GeometryError, RigidTransform
from radcam_depth_ros.messages import decode_points, decode_radar
from radcam_depth_ros.motion import Motion, OwnMotion, own_motion
from radcam_depth_ros.pairing import for_each_radar

_SECOND = 1_000_000_000
_LONGEST_S = 300.0
"""Only the beginning of a longer bag is read, since every image has to be decoded."""
_MOST_RETURNS = 600
"""Returns of a sweep that are kept."""
_HELD_SCANS = 8


class CalibrationError(RadcamDepthError):
    """A bag whose calibration cannot be checked, or a request that cannot be met."""


@dataclass(frozen=True)
class Sweep:
    """One sweep of a radar.

    Attributes:
        stamp_ns: With `radar_time_offset_s`.
        xyz_m: (N, 3) float32 metres, in the radar's frame.
        radial_speed_mps: (N,) float32, positive moving away; NaN where not given.
    """

    stamp_ns: int
    xyz_m: FloatArray
    radial_speed_mps: FloatArray


@dataclass(frozen=True)
class Radar:
    """A radar of a drive.

    Attributes:
        topic: Its topic.
        camera_from_radar: Its pose by the bag or the settings.
        sweeps: All of them, by time.
        is_over_ground: Its radial speeds are over ground already.
        own_motions: Its motion at each sweep, by Doppler; None where unknown.
    """

    topic: str
    camera_from_radar: Pose
    sweeps: tuple[Sweep, ...]
    is_over_ground: bool
    own_motions: tuple[OwnMotion | None, ...]


@dataclass(frozen=True)
class View:
    """An image that is used.

    Attributes:
        frame: The image with its returns, as the node sees them.
        radar_m: (N, 3) float32 metres of each radar, in that radar's frame.
        lidar_m: (M, 3) float32 metres of the nearest scan, in the LiDAR's frame; None where there is none.
    """

    frame: Frame
    radar_m: tuple[FloatArray, ...]
    lidar_m: FloatArray | None


@dataclass(frozen=True)
class Recording:
    """The parts of a drive that are used.

    Attributes:
        topics: Its topics.
        seconds: How long it is.
        seconds_read: How much of that was read.
        radars: Its radars.
        views: The images that are used, evenly spread.
        camera_from_lidar: The LiDAR's place; None where there is none.
        base_from_camera: From the camera to the frame whose motion is known; None if it is unknown.
        motion: The vehicle's.
        image_yaw_rate: Yaw rate of the camera by the images, rad/s to the left.
    """

    topics: SensorTopics
    seconds: float
    seconds_read: float
    radars: tuple[Radar, ...]
    views: tuple[View, ...]
    camera_from_lidar: Pose | None
    base_from_camera: RigidTransform | None
    motion: Motion
    image_yaw_rate: Signal


def read_recording(
    path: Path | str, settings: DriveSettings, frames: int, progress: Callable[[int, int], None]
) -> Recording:
    """Reads a bag once.

    Args:
        path: A rosbag2 folder or .mcap file.
        settings: How it is read.
        frames: Number of images that are used.
        progress: Called with (messages read, messages to read).

    Raises:
        RadcamDepthError: when the bag lacks a sensor or a transform, or holds a message that cannot be used.
    """
    if frames < 1:
        raise CalibrationError(f"frames must be at least 1, got {frames}")
    with BagReader(path) as reader:
        topics = settings.find_topics(reader)
        return _Reading(reader, topics, settings, frames).read(progress)


class _Reading:
    def __init__(self, reader: BagReader, topics: SensorTopics, settings: DriveSettings, frames: int) -> None:
        self._reader, self._topics, self._settings = reader, topics, settings
        config = settings.frame_builder_of(topics)
        self._frame_builder, self._aliases = FrameBuilder(config), config.field_aliases()
        self._offsets_s = for_each_radar(
            "radar_time_offset_s", settings.frame_builder.pairing.radar_time_offset_s, len(topics.radars)
        )
        self._seconds = reader.duration_ns / _SECOND
        self._share = min(1.0, _LONGEST_S / self._seconds) if self._seconds > 0 else 1.0
        images = max(1, int(reader.count([topics.image]) * self._share))
        self._picks = set(np.linspace(0, images - 1, min(frames, images)).round().astype(int).tolist())
        self._motion: Motion | None = None
        self._image_motion = ImageMotion()
        self._sweeps: dict[str, list[Sweep]] = {topic: [] for topic in topics.radars}
        self._over_ground: dict[str, bool] = {}
        self._radar_frames: dict[str, str] = {}
        self._views: list[tuple[Frame, list[BagMessage]]] = []
        self._scans: deque[BagMessage] = deque(maxlen=_HELD_SCANS)
        self._seen = 0

    def read(self, progress: Callable[[int, int], None]) -> Recording:
        topics, reader = self._topics, self._reader
        prime(reader, self._frame_builder, topics)
        motion_topic = topics.odometry or topics.tf
        names = {topics.image, topics.camera_info, *topics.radars}
        names |= {name for name in (topics.lidar, motion_topic) if name}
        total = max(1, int(reader.count(names) * self._share))
        stop_ns = reader.start_ns + round(_LONGEST_S * _SECOND)
        for number, item in enumerate(reader.messages(names, stop_ns=stop_ns), 1):
            self._take(item, motion_topic)
            if number % 20 == 0:
                progress(min(number, total), total)
        for frame in self._frame_builder.flush():
            self._look(frame)
        progress(total, total)
        return self._recording()

    def _take(self, item: BagMessage, motion_topic: str | None) -> None:
        topics, now_ns = self._topics, item.log_time_ns
        for frame in self._frame_builder.expire(now_ns):
            self._look(frame)
        if item.topic == topics.lidar:
            self._scans.append(item)
            for frame, scans in self._views[-_HELD_SCANS:]:
                if abs(header_stamp_ns(item.raw) - frame.stamp_ns) < _SECOND:
                    scans.append(item)
        elif item.topic == motion_topic:
            self._follow(item)
        else:
            if item.topic in topics.radars:
                self._sweep(item)
            for frame in self._frame_builder.add(item.topic, item.message, now_ns):
                self._look(frame)

    def _follow(self, item: BagMessage) -> None:
        if self._motion is None:
            frame_id = self._camera_frame()
            self._motion = Motion(
                item.topic,
                is_odometry=bool(self._topics.odometry),
                transforms=self._frame_builder.transforms,
                anchor=frame_id,
            )
        self._motion.add(item.message)

    def _camera_frame(self) -> str:
        for item in self._reader.messages([self._topics.image]):
            return self._settings.frame_builder.camera_frame or str(item.message.header.frame_id)
        return ""

    def _sweep(self, item: BagMessage) -> None:
        index = self._topics.radars.index(item.topic)
        reading = decode_radar(item.message, self._aliases[index])
        self._radar_frames.setdefault(item.topic, reading.frame_id)
        self._over_ground[item.topic] = reading.is_over_ground
        config = self._frame_builder.config
        stamp_ns = config.sweep_ns(item.topic, reading.stamp_ns, item.log_time_ns) + round(
            self._offsets_s[index] * _SECOND
        )
        xyz_m, speed_mps = reading.returns.xyz_m, reading.returns.radial_speed_mps
        if len(xyz_m) > _MOST_RETURNS:
            kept = np.linspace(0, len(xyz_m) - 1, _MOST_RETURNS).astype(int)
            xyz_m, speed_mps = xyz_m[kept], speed_mps[kept]
        self._sweeps[item.topic].append(Sweep(stamp_ns, xyz_m, speed_mps))

    def _look(self, frame: Frame) -> None:
        self._image_motion.add(frame)
        if self._seen in self._picks:
            self._views.append((frame, list(self._scans)))
        self._seen += 1

    def _recording(self) -> Recording:
        if not self._views:
            raise CalibrationError(f"no image of {self._reader.path} could be read; run `radcam-depth inspect`")
        frame_id = self._views[0][0].frame_id
        radars = tuple(self._radar(index, frame_id) for index in range(len(self._topics.radars)))
        lidar = None
        if any(scans for _, scans in self._views):
            lidar_frame = next(decode_points(scans[0].message).frame_id for _, scans in self._views if scans)
            lidar = Pose.of(self._frame_builder.transforms.lookup(frame_id, lidar_frame))
        views = tuple(self._view(frame, scans, radars) for frame, scans in self._views)
        motion = self._motion or Motion(
            "/odom", is_odometry=True, transforms=self._frame_builder.transforms, anchor=frame_id
        )
        base_from_camera = None
        if motion.base_frame is not None:
            try:
                base_from_camera = self._frame_builder.transforms.lookup(motion.base_frame, frame_id)
            except GeometryError:
                base_from_camera = None  # what the vehicle's motion would tell is then reported as unknown
        seconds_read = min(self._seconds, _LONGEST_S)
        return Recording(
            self._topics,
            self._seconds,
            seconds_read,
            radars,
            views,
            lidar,
            base_from_camera,
            motion,
            self._image_motion.yaw_rate,
        )

    def _radar(self, index: int, camera_frame: str) -> Radar:
        topic = self._topics.radars[index]
        sweeps = tuple(self._sweeps[topic])
        if not sweeps:
            raise CalibrationError(f"no cloud came on {topic} in the {_LONGEST_S:g} s that are read; leave it out")
        place = Pose.of(self._frame_builder.camera_from_radar(index, self._radar_frames[topic], camera_frame))
        is_over_ground = self._over_ground[topic]
        own = (None if is_over_ground else own_motion(sweep.xyz_m, sweep.radial_speed_mps) for sweep in sweeps)
        return Radar(topic, place, sweeps, is_over_ground, tuple(own))

    def _view(self, frame: Frame, scans: list[BagMessage], radars: tuple[Radar, ...]) -> View:
        radar_m = tuple(
            radar.camera_from_radar.inverse().apply(part.xyz_m)
            for radar, part in zip(radars, frame.radar_parts, strict=True)
        )
        limit_ns = round(self._settings.max_lidar_offset_s * _SECOND)
        nearest = min(scans, key=lambda item: abs(header_stamp_ns(item.raw) - frame.stamp_ns), default=None)
        if nearest is None or abs(header_stamp_ns(nearest.raw) - frame.stamp_ns) > limit_ns:
            return View(frame, radar_m, None)
        return View(frame, radar_m, decode_points(nearest.message).xyz_m)
