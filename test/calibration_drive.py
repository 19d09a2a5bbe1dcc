"""A drive past posts, made by hand: camera, radar with Doppler, LiDAR and odometry, with braking and turns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    OdometryReading,
    StampedTransform,
    encode_camera_info,
    encode_image,
    encode_odometry,
    encode_points,
    encode_transforms,
)

SECOND = 1_000_000_000
START_NS = 100 * SECOND
CAMERA = CameraModel(240, 120, 150.0, 150.0, 119.5, 59.5)
BASE_FROM_CAMERA = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([1.5, 0.0, 1.4]))
BASE_FROM_RADAR = RigidTransform.from_quaternion(
    (3.5, 0.3, 0.5), (0, 0, math.sin(math.radians(2)), math.cos(math.radians(2)))
)
BASE_FROM_LIDAR = RigidTransform(np.eye(3), np.array([0.5, 0.0, 1.8]))
CAMERA_FROM_RADAR = BASE_FROM_CAMERA.inverse() @ BASE_FROM_RADAR
CAMERA_FROM_LIDAR = BASE_FROM_CAMERA.inverse() @ BASE_FROM_LIDAR
_STEP_S = 0.01


@dataclass(frozen=True)
class PostsDrive:
    """What is in the bag.

    Attributes:
        seconds: How long it is.
        lidar: Write /lidar/points.
        odometry: Write /odom.
        varied: Brake and turn; else straight on, at one speed.
        radar_clock_s: How far the radar's stamps are behind what they should say.
        odometry_clock_s: How far the odometry's are.
        over_ground: Radial speeds are over ground.
    """

    seconds: float = 8.0
    lidar: bool = True
    odometry: bool = True
    varied: bool = True
    radar_clock_s: float = 0.0
    odometry_clock_s: float = 0.0
    over_ground: bool = False


def write_posts_drive(path: Path, drive: PostsDrive) -> Path:
    """Writes a drive."""
    events: list[tuple[int, str, object]] = []
    track, rng = _Track(drive), np.random.default_rng(5)
    posts = _posts(rng)
    tones = rng.integers(20, 235, (len(posts), 4, 2), dtype=np.uint8)
    for time_s in np.arange(0.0, drive.seconds, 0.1):
        stamp_ns = START_NS + round(time_s * SECOND)
        image = _image((track.pose(time_s) @ BASE_FROM_CAMERA).inverse().apply(posts), tones)
        events.append((stamp_ns, "/camera/image_raw", encode_image(factory, image, stamp_ns, "camera")))
        events.append((stamp_ns, "/camera/camera_info", encode_camera_info(factory, CAMERA, stamp_ns, "camera")))
        if drive.lidar:
            world_from_lidar = track.pose(time_s) @ BASE_FROM_LIDAR
            scan = _columns(_scan(world_from_lidar.inverse().apply(posts), rng))
            events.append((stamp_ns, "/lidar/points", encode_points(factory, scan, stamp_ns, "lidar")))
    for time_s in np.arange(-0.03, drive.seconds, 0.07):
        true_ns = START_NS + round(time_s * SECOND)
        stamp_ns = true_ns + round(drive.radar_clock_s * SECOND)
        cloud = encode_points(factory, _sweep(track, time_s, posts, rng, drive), stamp_ns, "radar")
        events.append((true_ns, "/radar/points", cloud))
    if drive.odometry:
        for time_s in np.arange(-0.6, drive.seconds + 0.6, 0.02):
            true_ns = START_NS + round(time_s * SECOND)
            stamp_ns = true_ns + round(drive.odometry_clock_s * SECOND)
            reading = OdometryReading(stamp_ns, "odom", "base_footprint", track.pose(time_s), np.zeros(3), np.zeros(3))
            events.append((true_ns, "/odom", encode_odometry(factory, reading)))
    links = [("camera", BASE_FROM_CAMERA), ("radar", BASE_FROM_RADAR), ("lidar", BASE_FROM_LIDAR)]
    stamped = [StampedTransform("base_footprint", name, START_NS, pose) for name, pose in links]
    with BagWriter(path) as writer:
        writer.write("/tf_static", encode_transforms(factory, stamped), START_NS - SECOND)
        for time_ns, topic, message in sorted(events, key=lambda event: event[:2]):
            writer.write(topic, message, time_ns)
    return path


class _Track:
    """Where the vehicle is."""

    def __init__(self, drive: PostsDrive) -> None:
        self._times_s = np.arange(-2.0, drive.seconds + 2.0, _STEP_S)
        much = 1.0 if drive.varied else 0.0
        speed = 8.0 + much * 3.0 * np.sin(2 * np.pi * self._times_s / 3.1)
        self._yaw = np.cumsum(much * 0.3 * np.sin(2 * np.pi * self._times_s / 2.6)) * _STEP_S
        self._x = np.cumsum(speed * np.cos(self._yaw)) * _STEP_S
        self._y = np.cumsum(speed * np.sin(self._yaw)) * _STEP_S

    def pose(self, time_s: float) -> RigidTransform:
        x, y, yaw = (float(np.interp(time_s, self._times_s, values)) for values in (self._x, self._y, self._yaw))
        return RigidTransform.from_quaternion((x, y, 0), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)))

    def velocity_mps(self, point_m: np.ndarray, time_s: float) -> np.ndarray:
        """Of a point fixed to the vehicle, in the world."""
        ends = [self.pose(time_s + step) for step in (-_STEP_S, _STEP_S)]
        before, after = (pose.rotation @ point_m + pose.translation for pose in ends)
        return np.asarray((after - before) / (2 * _STEP_S))


def _posts(rng: np.random.Generator) -> np.ndarray:
    """Feet of posts, (N, 3): more to the left than to the right, farther away to the right."""
    left = np.stack([rng.uniform(0, 180, 130), rng.uniform(5, 25, 130)], axis=1)
    right = np.stack([rng.uniform(0, 180, 60), rng.uniform(-40, -9, 60)], axis=1)
    places = np.concatenate([left, right])
    return np.column_stack([places, np.zeros(len(places))])


def _image(posts_m: FloatArray, tones: ImageArray) -> ImageArray:
    image = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
    for place in np.argsort(-posts_m[:, 2]):
        x, y, z = (float(value) for value in posts_m[place])
        if not 2.0 < z < 80.0:
            continue
        left, right = (round(CAMERA.fx * (x + side) / z + CAMERA.cx) for side in (-0.4, 0.4))
        top, bottom = (round(CAMERA.fy * (y - height) / z + CAMERA.cy) for height in (3.0, 0.0))
        if right <= 0 or left >= CAMERA.width or right - left < 2 or bottom - top < 4:
            continue
        texture = cv2.resize(tones[place], (right - left, bottom - top), interpolation=cv2.INTER_NEAREST)
        rows = slice(max(0, top), min(CAMERA.height, bottom))
        columns = slice(max(0, left), min(CAMERA.width, right))
        image[rows, columns] = texture[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return np.repeat(cv2.GaussianBlur(image, (3, 3), 0)[..., None], 3, axis=2)


def _scan(posts_m: FloatArray, rng: np.random.Generator) -> np.ndarray:
    near = posts_m[np.linalg.norm(posts_m, axis=1) < 70.0]
    bodies = np.concatenate([near + np.array([0, 0, height]) for height in (0.6, 1.2, 2.4)])
    around, distance = np.meshgrid(np.linspace(-np.pi, np.pi, 60), [4.0, 7.0, 12.0])
    road = np.stack([distance * np.cos(around), distance * np.sin(around), np.full_like(distance, -1.8)], axis=-1)
    points = np.concatenate([bodies, road.reshape(-1, 3)])
    return np.asarray(points + rng.normal(0, 0.03, points.shape))


def _sweep(
    track: _Track, time_s: float, posts_m: np.ndarray, rng: np.random.Generator, drive: PostsDrive
) -> dict[str, np.ndarray]:
    world_from_radar = track.pose(time_s) @ BASE_FROM_RADAR
    heights = rng.uniform(0.1, 6.0, len(posts_m))
    there = world_from_radar.inverse().apply(posts_m + np.outer(heights, [0, 0, 1])).astype(np.float64)
    seen = (there[:, 0] > 1.0) & (np.abs(there[:, 1]) < 1.7 * there[:, 0]) & (np.linalg.norm(there, axis=1) < 70.0)
    there = there[seen & (rng.random(len(there)) < 0.8)]
    sight = there / np.linalg.norm(there, axis=1, keepdims=True)
    velocity = world_from_radar.rotation.T @ track.velocity_mps(BASE_FROM_RADAR.translation, time_s)
    speed = rng.normal(0, 0.1, len(there)) - (0.0 if drive.over_ground else 1.0) * (sight @ velocity)
    columns = _columns(there + rng.normal(0, 0.1, there.shape))
    if drive.over_ground:
        return {
            **columns,
            "vx_comp": (speed * sight[:, 0]).astype(np.float32),
            "vy_comp": (speed * sight[:, 1]).astype(np.float32),
        }
    return {**columns, "velocity": speed.astype(np.float32)}


def _columns(points_m: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip("xyz", np.asarray(points_m, np.float32).T.copy(), strict=True))
