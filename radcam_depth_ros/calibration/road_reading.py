"""Reads scans, images and the travel between images, from which the road below a camera is estimated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from radcam_depth_ros.bags import RADAR_TYPES, BagReader, header_stamp_ns
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.calibration.recording import CalibrationError
from radcam_depth_ros.calibration.signals import Signal
from radcam_depth_ros.drive import DriveSettings, prime
from radcam_depth_ros.frame import CameraModel, FloatArray, Frame, GroundPlane, ImageArray
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.geometry import DoubleArray, GeometryError, RigidTransform
from radcam_depth_ros.messages import RadarReading, decode_points, decode_radar
from radcam_depth_ros.motion import Motion, own_motion
from radcam_depth_ros.pairing import PairingConfig, for_each_radar
from radcam_depth_ros.resampling import rectify

WIDTH_PX = 800
"""Images are looked at no wider than this."""
TRAVEL_M = (0.5, 4.0)
"""Images are compared over so much travel."""
BEST_TRAVEL_M = 1.6
_LONGEST_S = 1.0
_SECOND = 1_000_000_000
_MOST_SWEEPS, _MOST_STARTS = 3000, 2000
_LEAST_SHARE = 0.5
_FILLED = 0.6
"""Where a hundredth of the radial speeds lie beyond this share of the extremes, both ways, Doppler is ambiguous."""
_UNSTEADY = 0.05
"""Speeds that jump by this share from sweep to sweep are wrong."""
_STRAY_MPS = 1.0
_STILL_MPS = 0.3


@dataclass(frozen=True)
class ImagePair:
    """Two images of a drive.

    Attributes:
        first: (H, W) grey, rectified.
        second: The later one.
        camera: Of both.
        distance_m: How far the camera travelled in between.
    """

    first: ImageArray
    second: ImageArray
    camera: CameraModel
    distance_m: float


class RoadReading:
    """A bag opened for its road; a context manager's reader.

    Args:
        reader: The bag.
        settings: How it is read.

    Attributes:
        topics: The bag's sensors.
        ground: The road as transforms or parameters tell it.
        source: Where the travel comes from: `odometry` or `doppler`; empty where nothing tells.
        travel_error: Standard deviation of the travel, as a share of it.
        travelled_m: From the first pair of images to the last one.

    Raises:
        RadcamDepthError: when the bag lacks a camera, or holds a message that cannot be used.
    """

    def __init__(self, reader: BagReader, settings: DriveSettings) -> None:
        self._reader, self._settings = reader, settings
        self.topics = self._find_topics()
        self._config = settings.frame_builder_of(self.topics)
        self._transforms = self._new_builder().transforms
        self._stamps_ns = np.array([header_stamp_ns(item.raw) for item in reader.messages([self.topics.image])])
        first = next(self._frames({0}), None)
        if first is None:
            raise CalibrationError(f"no image of {reader.path} could be read; run `radcam-depth inspect`")
        self._camera_frame = first.frame_id
        self.ground: GroundPlane = first.ground
        self.source, self.travel_error, self.travelled_m = "", 0.0, 0.0

    def scans(self, most: int) -> Iterator[FloatArray]:
        """At most so many scans of the LiDAR, evenly spread, (N, 3) in the camera's axes; none where there is none."""
        topic = self.topics.lidar
        if topic is None:
            return
        transforms = self._transforms
        picks = _spread(self._reader.count([topic]), most)
        for number, item in enumerate(self._reader.messages([topic])):
            if number in picks:
                scan = decode_points(item.message)
                if not transforms.can_transform(self._camera_frame, scan.frame_id):
                    return
                yield transforms.lookup(self._camera_frame, scan.frame_id).apply(scan.xyz_m)

    def pairs(self, most: int) -> Iterator[ImagePair]:
        """At most so many pairs of images, evenly spread over where the vehicle moves."""
        travel = self._travel()
        found = self._choose(travel, most)
        self.travelled_m = sum(
            travel(*self._stamps_ns[[start, end]].tolist()) for (start, _, _), (end, _, _) in itertools.pairwise(found)
        )
        ends = {second for _, second, _ in found}
        by_first = {first: (second, distance_m) for first, second, distance_m in found}
        held: dict[int, tuple[ImageArray, CameraModel]] = {}
        numbers = {int(self._stamps_ns[number]): number for number in (*by_first, *ends)}
        for frame in self._frames(set(numbers.values())):
            number = numbers[frame.stamp_ns]
            held[number] = _grey(frame)
            for first in [first for first, (second, _) in by_first.items() if second == number and first in held]:
                distance_m = by_first[first][1]
                yield ImagePair(held[first][0], held[number][0], held[first][1], distance_m)
            needed = [first for first, (second, _) in by_first.items() if second > number]
            held = {key: value for key, value in held.items() if key in needed}

    def _find_topics(self) -> SensorTopics:
        choice = self._settings.topics
        clouds = [topic for topic in self._reader.topics if topic.type_name in RADAR_TYPES]
        if choice.radars is None and len(clouds) <= (choice.lidar is not None):
            choice = replace(choice, radars=())
        return replace(self._settings, topics=choice).find_topics(self._reader)

    def _new_builder(self) -> FrameBuilder:
        """A builder of frames without radar returns."""
        without = replace(
            self._config,
            radars=(),
            radar_frame="",
            radar_stamps="header",
            radar_fields="",
            camera_from_radar=(),
            radar_motion_compensation=False,
            odometry="",
            pairing=PairingConfig(),
        )
        builder = FrameBuilder(without)
        prime(self._reader, builder, self.topics)
        return builder

    def _frames(self, numbers: set[int]) -> Iterator[Frame]:
        """The frames of some images, by their places in the bag."""
        if not numbers:
            return
        builder, topic = self._new_builder(), self.topics.image
        for number, item in enumerate(self._reader.messages([topic])):
            if number in numbers:
                yield from builder.add(topic, item.message, item.log_time_ns)
            if number >= max(numbers):
                break
        yield from builder.flush()

    def _travel(self) -> Callable[[int, int], float]:
        """The camera's travel in metres between two times; NaN where unknown."""
        motion = self._motion()
        if motion is not None and motion.base_frame is not None:
            self.source = "odometry"
            return _by_poses(motion, self._base_from_camera(motion.base_frame))
        speed = self._doppler()
        if speed is None:
            return lambda start_ns, end_ns: float("nan")
        self.source, self.travel_error = "doppler", _unsteadiness(speed)

        def travelled(start_ns: int, end_ns: int) -> float:
            times_s = np.linspace(start_ns, end_ns, 9) / _SECOND
            return float(speed.at(times_s).mean() * (end_ns - start_ns) / _SECOND)

        return travelled

    def _motion(self) -> Motion | None:
        topics = self.topics
        topic = topics.odometry or topics.tf
        if topic is None:
            return None
        motion = Motion(
            topic,
            is_odometry=bool(topics.odometry),
            transforms=self._transforms,
            anchor=self._camera_frame,
        )
        for item in self._reader.messages([topic]):
            motion.add(item.message)
        return motion

    def _base_from_camera(self, base_frame: str) -> RigidTransform:
        try:
            return self._transforms.lookup(base_frame, self._camera_frame)
        except GeometryError:
            # In turns the camera travels a little farther than the base.
            return RigidTransform.identity()

    def _doppler(self) -> Signal | None:
        """The speed by the radar that most of the scene's standing returns agree with."""
        offsets_s = for_each_radar(
            "radar_time_offset_s",
            self._settings.frame_builder.pairing.radar_time_offset_s,
            len(self.topics.radars),
        )
        found: list[tuple[float, Signal]] = []
        for index, offset_s in enumerate(offsets_s):
            shares, times_s, speeds, radial = [0.0], [], [], []
            for reading in self._sweeps(index):
                returns = reading.returns
                own = own_motion(returns.xyz_m, returns.radial_speed_mps)
                radial.append(returns.radial_speed_mps[np.isfinite(returns.radial_speed_mps)])
                shares.append(0.0 if own is None else own.share)
                if own is not None and self._is_ahead(index, reading.frame_id, own.velocity_mps):
                    times_s.append(reading.stamp_ns / _SECOND + offset_s)
                    speeds.append(own.speed_mps)
            if 2 * len(speeds) < len(shares) or _is_ambiguous(np.concatenate(radial)):
                continue
            speed, share = _steady(Signal.of(times_s, speeds)), float(np.median(shares))
            if share >= _LEAST_SHARE and _unsteadiness(speed) < _UNSTEADY:
                found.append((share, speed))
        return max(found, key=lambda item: item[0])[1] if found else None

    def _sweeps(self, index: int) -> Iterator[RadarReading]:
        """A radar's sweeps with speeds relative to it, evenly spread."""
        topic, aliases = self.topics.radars[index], self._config.field_aliases()[index]
        picks = _spread(self._reader.count([topic]), _MOST_SWEEPS)
        for number, item in enumerate(self._reader.messages([topic])):
            if number in picks:
                reading = decode_radar(item.message, aliases)
                reading = replace(reading, stamp_ns=self._config.sweep_ns(topic, reading.stamp_ns, item.log_time_ns))
                if not reading.is_over_ground:
                    yield reading

    def _is_ahead(self, index: int, radar_frame: str, velocity_mps: DoubleArray) -> bool:
        """Whether a radar's velocity is along the camera's view; True where nobody tells how the radar is mounted."""
        radar_frame = (
            for_each_radar("radar_frame", self._config.radar_frame, len(self.topics.radars))[index] or radar_frame
        )
        fixed = np.reshape(self._config.camera_from_radar, (-1, 7))
        if len(fixed):
            rotation = RigidTransform.from_quaternion(fixed[index, :3], fixed[index, 3:]).rotation
        elif self._transforms.can_transform(self._camera_frame, radar_frame):
            rotation = self._transforms.lookup(self._camera_frame, radar_frame).rotation
        else:
            return True
        return bool((rotation @ velocity_mps)[2] > -_STILL_MPS)

    def _choose(self, travel: Callable[[int, int], float], most: int) -> list[tuple[int, int, float]]:
        """Pairs of images (first, second, metres), evenly spread."""
        stamps_ns, found = self._stamps_ns, []
        for first in sorted(_spread(len(stamps_ns), _MOST_STARTS)):
            best, start_ns = None, int(stamps_ns[first])
            for second in range(first + 1, len(stamps_ns)):
                end_ns = int(stamps_ns[second])
                if end_ns - start_ns > _LONGEST_S * _SECOND:
                    break
                distance_m = travel(start_ns, end_ns)
                if not TRAVEL_M[0] <= distance_m <= TRAVEL_M[1]:
                    continue
                if best is None or abs(np.log(distance_m / BEST_TRAVEL_M)) < abs(np.log(best[2] / BEST_TRAVEL_M)):
                    best = (first, second, distance_m)
            if best is not None:
                found.append(best)
        return [found[place] for place in sorted(_spread(len(found), most))]


def _by_poses(motion: Motion, base_from_camera: RigidTransform) -> Callable[[int, int], float]:
    def travelled(start_ns: int, end_ns: int) -> float:
        start, end = motion.at(start_ns), motion.at(end_ns)
        if start is None or end is None:
            return float("nan")
        return float(np.linalg.norm((end @ base_from_camera).translation - (start @ base_from_camera).translation))

    return travelled


def _is_ambiguous(radial_mps: FloatArray) -> bool:
    """Whether radial speeds fill an interval to both ends: those beyond have been folded into it."""
    if not len(radial_mps):
        return False
    low, high = np.percentile(radial_mps, [1, 99])
    return bool(low < _FILLED * radial_mps.min() < 0 and high > _FILLED * radial_mps.max() > 0)


def _around(values: DoubleArray) -> DoubleArray:
    """The median of the values around each."""
    return np.array([np.median(values[max(0, place - 4) : place + 5]) for place in range(len(values))])


def _unsteadiness(speed: Signal) -> float:
    """Standard deviation of a single speed, as a share of the usual one."""
    off = np.abs(speed.values - _around(speed.values))
    return float(1.4826 * np.median(off) / max(1.0, float(np.median(speed.values)))) if len(off) else math.inf


def _steady(speed: Signal) -> Signal:
    """Without the sweeps whose speed is not that of those around them."""
    values = speed.values
    around = _around(values)
    return Signal.of(speed.times_s.tolist(), np.where(np.abs(values - around) < _STRAY_MPS, values, np.nan).tolist())


def _spread(count: int, most: int) -> set[int]:
    """At most so many of the numbers below `count`, evenly spread."""
    return set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()) if count else set()


def _grey(frame: Frame) -> tuple[ImageArray, CameraModel]:
    """A frame's image rectified, grey and no wider than `WIDTH_PX`, with its camera."""
    camera = frame.camera
    image = cv2.cvtColor(rectify(frame.image, camera, frame.lens), cv2.COLOR_RGB2GRAY)
    scale = WIDTH_PX / camera.width
    if scale >= 1:
        return image, camera
    width, height = WIDTH_PX, max(1, round(camera.height * scale))
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), camera.resized(width, height)
