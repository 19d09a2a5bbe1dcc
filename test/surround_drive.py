"""A drive made by hand with cameras and radars all around, a LiDAR and exact poses, in a world that stands still."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import DoubleArray, RigidTransform
from radcam_depth_ros.messages import (
    OdometryReading,
    StampedTransform,
    encode_camera_info,
    encode_compressed_image,
    encode_odometry,
    encode_points,
    encode_transforms,
)

US = 1_000
"""Nanoseconds of a microsecond: stamps are whole microseconds, as in nuScenes."""
START_US = 1_533_151_603_500_000
CAMERA = CameraModel(160, 90, 126.6, 126.6, 81.6, 49.1)
SPEED_MPS, YAW_RATE = 10.0, 0.1
_YAW_DEG = {"front": 0, "front_left": 55, "front_right": -55, "back": 180, "back_left": 110, "back_right": -110}
_AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""An optical frame that looks ahead."""
STATES = ("is_quality_valid", "ambig_state", "x_rms", "y_rms", "invalid_state", "pdh0", "vx_rms", "vy_rms")


@dataclass(frozen=True)
class SurroundDrive:
    """What is in the bag.

    Attributes:
        seed: Of the world and of the images.
        seconds: Its length.
        cameras: Which cameras, by the names of `_YAW_DEG`.
        radars: Which radars, likewise.
        scenario: What `/scenario` says.
        empty_sweep: Number of the front radar's sweep that has no return; None for none.
    """

    seed: int = 0
    seconds: float = 1.2
    cameras: tuple[str, ...] = ("front",)
    radars: tuple[str, ...] = ("front",)
    scenario: tuple[tuple[str, str], ...] = (("weather", "clear"), ("time_of_day", "day"))
    empty_sweep: int | None = None


def mount(kind: str, name: str = "") -> RigidTransform:
    """`ego_from_sensor` of a camera, a radar or the LiDAR, each a little turned about all axes."""
    if kind == "lidar":
        return turned(RigidTransform(_rotation(-1.57), np.array([0.94, 0.0, 1.84])), 0.004)
    place = np.array([1.7, 0.02, 1.51] if kind == "camera" else [3.4, 0.0, 0.5])
    yaw = _rotation(np.deg2rad(_YAW_DEG[name]))
    return turned(RigidTransform(yaw @ (_AHEAD if kind == "camera" else np.eye(3)), yaw @ place), 0.007)


def turned(pose: RigidTransform, by: float) -> RigidTransform:
    return pose @ RigidTransform.from_quaternion([0, 0, 0], [by, -by, by / 2, 1.0])


def pose_at(time_us: int) -> RigidTransform:
    """`global_from_ego`: along an arc, far from the origin, on a road that rises a little."""
    time_s = (time_us - START_US) / 1e6
    yaw, radius = 0.4 + YAW_RATE * time_s, SPEED_MPS / YAW_RATE
    place = radius * np.array([np.sin(yaw), -np.cos(yaw), 0.0]) + [1200.0, 900.0, 0.05 * time_s]
    return turned(RigidTransform(_rotation(yaw), place), 0.002)


def write_surround_drive(path: Path, drive: SurroundDrive) -> Path:
    """Writes a drive: cameras of 12 Hz, radars of 13 Hz, a LiDAR of 20 Hz, a pose for each measurement."""
    rng = np.random.default_rng(drive.seed)
    world = world_points(drive.seed)
    sensors = [("camera", name, 12.0) for name in drive.cameras] + [("radar", name, 13.0) for name in drive.radars]
    events: list[tuple[int, str, str, int]] = []
    for kind, name, rate_hz in (*sensors, ("lidar", "top", 20.0)):
        first_us = START_US + int(rng.integers(0, 40_000))
        count = int(drive.seconds * rate_hz)
        events += [(first_us + round(1e6 * index / rate_hz), kind, name, index) for index in range(count)]
    with BagWriter(path, latched=("/tf_static", "/scenario")) as writer:
        stamp_ns = (START_US - 1000) * US
        writer.write("/tf_static", encode_transforms(factory, _mounts(drive, stamp_ns)), stamp_ns)
        text = json.dumps(dict(drive.scenario))
        writer.write("/scenario", factory("std_msgs/msg/String", data=text), stamp_ns)
        for time_us, kind, name, index in sorted(events):
            _write_pose(writer, time_us)
            _write(writer, drive, world, rng, (time_us, kind, name, index))
    return path


def world_points(seed: int) -> FloatArray:
    """(N, 3) points that stand still around the drive, metres in the global frame."""
    rng = np.random.default_rng(seed)
    angle, distance = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(3, 95, 4000)
    height = rng.uniform(0.0, 6.0, 4000)
    around = np.stack([distance * np.cos(angle), distance * np.sin(angle), height], axis=1)
    middle = pose_at(START_US + 600_000)
    return (around + middle.translation).astype(np.float64)  # float32 would be too coarse so far out


def _write(
    writer: BagWriter,
    drive: SurroundDrive,
    world: DoubleArray,
    rng: np.random.Generator,
    event: tuple[int, str, str, int],
) -> None:
    time_us, kind, name, index = event
    stamp_ns = time_us * US
    seen = (pose_at(time_us) @ mount(kind, name)).inverse()
    if kind == "camera":
        image = rng.integers(0, 255, (CAMERA.height // 10, CAMERA.width // 10, 3), np.uint8).repeat(10, 0).repeat(10, 1)
        topic, frame = f"/camera/{name}", f"cam_{name}"
        writer.write(
            f"{topic}/image_raw/compressed", encode_compressed_image(factory, image, stamp_ns, frame), stamp_ns
        )
        writer.write(f"{topic}/camera_info", encode_camera_info(factory, CAMERA, stamp_ns, frame), stamp_ns)
        return
    if kind == "lidar":
        xyz = seen.apply(world[rng.random(len(world)) < 0.5])
        columns = dict(zip("xyz", xyz.T, strict=True))
        columns["intensity"] = rng.uniform(0, 255, len(xyz)).astype(np.float32)
        columns["ring"] = rng.integers(0, 32, len(xyz)).astype(np.float32)
        writer.write("/lidar/points", encode_points(factory, columns, stamp_ns, "lidar_top"), stamp_ns)
        return
    xyz = seen.apply(world[rng.integers(0, len(world), 60)])
    xyz = xyz[xyz[:, 0] > 0] * np.array([1.0, 1.0, 0.0], np.float32)  # it measures no elevation
    if name == "front" and index == drive.empty_sweep:
        xyz = xyz[:0]
    columns = radar_columns(xyz, -mount(kind, name).rotation.T @ _velocity(mount(kind, name)), rng)
    writer.write(f"/radar/{name}/points", encode_points(factory, columns, stamp_ns, f"radar_{name}"), stamp_ns)


def radar_columns(xyz: FloatArray, velocity: DoubleArray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The columns of nuScenes' radar files, of things that stand still, seen from a radar that moves."""
    count = len(xyz)
    sight = xyz / np.maximum(np.linalg.norm(xyz, axis=1, keepdims=True), 1e-6)
    radial = sight @ velocity
    floats = {"vx": radial * sight[:, 0], "vy": radial * sight[:, 1], "vx_comp": radial * 0, "vy_comp": radial * 0}
    return {
        **dict(zip("xyz", xyz.T, strict=True)),
        "dyn_prop": rng.integers(0, 8, count).astype(np.int8),
        "id": np.arange(count, dtype=np.int16),
        "rcs": rng.uniform(-5, 30, count).astype(np.float32),
        **{name: values.astype(np.float32) for name, values in floats.items()},
        **{name: rng.integers(0, 5, count).astype(np.int8) for name in STATES},
    }


def _velocity(place: RigidTransform) -> DoubleArray:
    """(3,) m/s over ground of a place on the vehicle, in the vehicle's axes."""
    return np.array([SPEED_MPS, 0.0, 0.0]) + np.cross([0.0, 0.0, YAW_RATE], place.translation)


def _mounts(drive: SurroundDrive, stamp_ns: int) -> list[StampedTransform]:
    links = [("lidar_top", mount("lidar"))]
    links += [(f"cam_{name}", mount("camera", name)) for name in drive.cameras]
    links += [(f"radar_{name}", mount("radar", name)) for name in drive.radars]
    return [StampedTransform("base_footprint", child, stamp_ns, pose) for child, pose in links]


def _write_pose(writer: BagWriter, time_us: int) -> None:
    moving, turning = np.array([SPEED_MPS, 0.0, 0.0]), np.array([0.0, 0.0, YAW_RATE])
    reading = OdometryReading(time_us * US, "odom", "base_footprint", pose_at(time_us), moving, turning)
    writer.write("/odom", encode_odometry(factory, reading), time_us * US)


def _rotation(yaw: float) -> DoubleArray:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
