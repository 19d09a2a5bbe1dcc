"""A straight drive over a textured plane towards a textured wall, made by hand: camera, radar, LiDAR and odometry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.frame import CameraModel, ImageArray
from radcam_depth_ros.frame_builder import level_ground
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
CAMERA = CameraModel(480, 288, 380.0, 380.0, 242.0, 140.0)
HEIGHT_M, PITCH_DEG, ROLL_DEG = 1.5, 2.0, -1.0
_WALL_M = 60.0
_PIXELS_A_METRE = 40


@dataclass(frozen=True)
class PlaneDrive:
    """What is in the bag.

    Attributes:
        images: How many, ten a second.
        speed_mps: How fast.
        texture: Contrast of the road and the wall, grey values.
        lidar: Write /lidar/points: the road and boxes on it.
        scan_has_road: The scans have the road, not only the boxes.
        odometry: Write /odom.
        doppler: The radar tells radial speeds.
        told_height_m: The camera's height by the transforms.
    """

    images: int = 8
    speed_mps: float = 14.0
    texture: float = 40.0
    lidar: bool = False
    scan_has_road: bool = True
    odometry: bool = True
    doppler: bool = True
    told_height_m: float = HEIGHT_M


def base_from_camera(height_m: float = HEIGHT_M) -> RigidTransform:
    """The camera's place, 1 m ahead of the base."""
    up = np.array(level_ground(height_m, PITCH_DEG, ROLL_DEG).up)
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead /= np.linalg.norm(ahead)
    rotation = np.stack([ahead, np.cross(up, ahead), up])
    return RigidTransform(rotation, np.array([1.0, 0.0, height_m]))


def render(x_m: float, texture: float = 40.0) -> ImageArray:
    """(H, W) grey, what the camera sees after so many metres."""
    rng = np.random.default_rng(3)
    pattern = sum(cv2.GaussianBlur(rng.normal(0, 1, (1024, 1024)), (0, 0), width) * width for width in (1.2, 3.0, 9.0))
    pattern = np.asarray(pattern / pattern.std(), np.float32)
    place = base_from_camera()
    columns, rows = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = np.stack([(columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy, np.ones(rows.shape)], axis=-1)
    rays = rays @ place.rotation.T
    eye = place.translation + np.array([x_m, 0.0, 0.0])
    with np.errstate(divide="ignore"):
        to_road = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
    to_wall = (_WALL_M - eye[0]) / rays[..., 0]
    points = eye + np.minimum(to_road, to_wall)[..., None] * rays
    on_road = to_road < to_wall
    u = np.where(on_road, points[..., 0], points[..., 1] / 4) * _PIXELS_A_METRE
    v = np.where(on_road, points[..., 1], points[..., 2] / 4) * _PIXELS_A_METRE
    grey = cv2.remap(pattern, *(np.float32(part % 1023) for part in (u, v)), cv2.INTER_LINEAR)
    noise = np.random.default_rng(round(1000 * x_m)).normal(0, 1.0, grey.shape)
    return np.asarray(np.clip(120 + texture * grey + noise, 0, 255), np.uint8)


def scan(rng: np.random.Generator, has_road: bool = True) -> np.ndarray:
    """(N, 3) LiDAR points in the camera's axes: boxes, and the road around the vehicle."""
    around, distance = np.meshgrid(np.linspace(-np.pi, np.pi, 200), np.geomspace(3.0, 20.0, 12))
    road = np.stack([distance * np.cos(around), distance * np.sin(around), np.zeros_like(distance)], axis=-1)
    boxes = rng.uniform([-15, 2.0, 0.1], [15, 4.0, 2.0], (800, 3))
    boxes[:, 1] *= rng.choice([-1, 1], len(boxes))
    points = np.concatenate([road.reshape(-1, 3), boxes]) if has_road else boxes + np.array([0, 0, 4.0])
    points = points + rng.normal(0, 0.02, points.shape)
    return np.asarray(base_from_camera().inverse().apply(points))


def write_plane_drive(path: Path, drive: PlaneDrive) -> Path:
    """Writes a drive."""
    rng = np.random.default_rng(1)
    events: list[tuple[int, str, object]] = []
    for number in range(drive.images):
        stamp_ns, x_m = START_NS + number * SECOND // 10, drive.speed_mps * number / 10
        image = np.repeat(render(x_m, drive.texture)[..., None], 3, axis=2)
        events.append((stamp_ns, "/camera/image_raw", encode_image(factory, image, stamp_ns, "camera")))
        events.append((stamp_ns, "/camera/camera_info", encode_camera_info(factory, CAMERA, stamp_ns, "camera")))
        if drive.lidar:
            points = _columns(scan(rng, drive.scan_has_road))
            events.append((stamp_ns, "/lidar/points", encode_points(factory, points, stamp_ns, "camera")))
    for number in range(-2, drive.images + 2):
        stamp_ns = START_NS + number * SECOND // 10
        there = rng.uniform([5, -20, 0], [50, 20, 3], (60, 3))
        cloud = _columns(there)
        if drive.doppler:
            cloud["velocity"] = np.float32(-drive.speed_mps * there[:, 0] / np.linalg.norm(there, axis=1))
        events.append((stamp_ns, "/radar/points", encode_points(factory, cloud, stamp_ns, "radar")))
        if drive.odometry:
            pose = RigidTransform(np.eye(3), np.array([drive.speed_mps * number / 10, 0.0, 0.0]))
            reading = OdometryReading(stamp_ns, "odom", "base_footprint", pose, np.zeros(3), np.zeros(3))
            events.append((stamp_ns, "/odom", encode_odometry(factory, reading)))
    places = {"camera": base_from_camera(drive.told_height_m), "radar": RigidTransform(np.eye(3), np.zeros(3))}
    links = [StampedTransform("base_footprint", name, START_NS, place) for name, place in places.items()]
    with BagWriter(path) as writer:
        writer.write("/tf_static", encode_transforms(factory, links), START_NS - SECOND)
        for time_ns, topic, message in sorted(events, key=lambda event: event[:2]):
            writer.write(topic, message, time_ns)
    return path


def _columns(points_m: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip("xyz", np.asarray(points_m, np.float32).T.copy(), strict=True))
