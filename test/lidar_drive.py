"""Drives with a LiDAR made by hand: towards a wall, past a box that crosses the road."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.frame import CameraModel, FloatArray
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
CAMERA = CameraModel(128, 96, 100.0, 100.0, 63.5, 47.5)
OPTICAL = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([1.0, 0.0, 1.5]))
LIDAR = RigidTransform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([0.0, 0.0, 1.8]))
"""On the vehicle; turned to the left."""
WALL_M = 60.0
SPEED_MPS = 5.0


@dataclass(frozen=True)
class LidarDrive:
    """What is in the bag.

    Attributes:
        frames: Images, ten a second.
        odometry: Write /odom.
        tf: Write /tf.
        lidar_every: Write every so many scans.
        lidar_clock_s: How far the LiDAR's stamps are ahead.
        radar_clock_s: How far the radar's are.
        radar_frames: Radar sweeps, if not one a frame.
        log_clocks: Recorded times are those of the stamps, wrong as they are.
        lidar_frame: The scans' frame.
        loops: How often the drive comes.
        motion_from_s: Poses before this are missing,
        motion_until_s: and those after this.
        odometry_frame: What the odometry moves.
        doppler: Radar returns on a standing wall, with their Doppler.
    """

    frames: int = 12
    odometry: bool = True
    tf: bool = False
    lidar_every: int = 1
    lidar_clock_s: float = 0.0
    radar_clock_s: float = 0.0
    radar_frames: int | None = None
    log_clocks: bool = False
    lidar_frame: str = "lidar"
    loops: int = 1
    motion_from_s: float = -1.0
    motion_until_s: float = 1e9
    odometry_frame: str = "base"
    doppler: bool = False


def box_left_m(time_s: float) -> float:
    """Where the right side of the box is, to the left of the road's middle; it is 4 m wide, at x = 30 m."""
    return -12.0 + 10.0 * time_s


def scan_points(time_s: float) -> FloatArray:
    """What the LiDAR sees, (N, 3) metres around it in the vehicle's axes: in each direction box or wall."""
    azimuth, elevation = np.meshgrid(np.deg2rad(np.arange(-35, 35, 0.5)), np.deg2rad(np.arange(-1.5, 12, 0.75)))
    rays = np.stack([np.ones_like(azimuth), np.tan(azimuth), np.tan(elevation)], axis=-1).reshape(-1, 3)
    ahead = SPEED_MPS * time_s
    to_box, to_wall = 30.0 - ahead, WALL_M - ahead
    left = rays[:, 1] * to_box - box_left_m(time_s)
    hits_box = (left > 0) & (left < 4) & (rays[:, 2] * to_box < 1.5)
    return np.asarray(rays * np.where(hits_box, to_box, to_wall)[:, None], np.float32)


def write_lidar_drive(path: Path, drive: LidarDrive) -> Path:
    """Writes a drive."""
    events = [
        event for loop in range(drive.loops) for event in sorted(_events(drive, loop), key=lambda event: event[0])
    ]
    with BagWriter(path, overwrite=True) as writer:
        links = [("base", "camera", OPTICAL), ("base", "lidar", LIDAR), ("base", "radar", LIDAR)]
        stamped = [StampedTransform(parent, child, START_NS, pose) for parent, child, pose in links]
        writer.write("/tf_static", encode_transforms(factory, stamped), START_NS - SECOND)
        for time_ns, topic, message in events:
            writer.write(topic, message, time_ns)
    return path


def _events(drive: LidarDrive, loop: int) -> list[tuple[int, str, object]]:
    events: list[tuple[int, str, object]] = []
    later_ns = round(loop * (drive.frames / 10 + 1) * SECOND)

    def add(topic: str, time_s: float, clock_s: float, message: Callable[[int], object]) -> None:
        true_ns = START_NS + round(time_s * SECOND)
        stamp_ns = true_ns + round(clock_s * SECOND)
        events.append(((stamp_ns if drive.log_clocks else true_ns) + later_ns, topic, message(stamp_ns)))

    image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    columns = _returns(drive)
    radar_frames = drive.frames if drive.radar_frames is None else drive.radar_frames
    for index in range(drive.frames):
        time_s = index / 10
        add("/camera/image_raw", time_s, 0, lambda stamp: encode_image(factory, image, stamp, "camera"))
        add("/camera/camera_info", time_s, 0, lambda stamp: encode_camera_info(factory, CAMERA, stamp, "camera"))
        if index < radar_frames:
            clock_s = drive.radar_clock_s
            add("/radar/points", time_s + 0.01, clock_s, lambda stamp: encode_points(factory, columns, stamp, "radar"))
        if index % drive.lidar_every == 0:
            xyz = LIDAR.inverse().rotation @ scan_points(time_s + 0.02).T
            cloud = dict(zip("xyz", xyz.astype(np.float32), strict=True))
            add(
                "/lidar/points",
                time_s + 0.02,
                drive.lidar_clock_s,
                lambda stamp, cloud=cloud: encode_points(factory, cloud, stamp, drive.lidar_frame),  # type: ignore[misc]  # a default is no type
            )
    for index in range(-1, drive.frames * 5 + 2):
        time_s = index / 50
        if not drive.motion_from_s <= time_s <= drive.motion_until_s:
            continue
        place = RigidTransform(np.eye(3), np.array([1e5 + SPEED_MPS * time_s, 2e5, 0.0]))
        if drive.odometry:
            reading = OdometryReading(0, "odom", drive.odometry_frame, place, np.zeros(3), np.zeros(3))
            add("/odom", time_s, 0, lambda stamp, reading=reading: _odometry(reading, stamp))  # type: ignore[misc]  # a default is no type
        if drive.tf:
            add("/tf", time_s, 0, lambda stamp, place=place: _links(place, stamp))  # type: ignore[misc]  # a default is no type
    return events


def _returns(drive: LidarDrive) -> dict[str, FloatArray]:
    """What the radar sees, around it: one thing ahead, or a wall."""
    if not drive.doppler:
        return dict(zip("xyz", np.array([[0.0, -20, 0]], np.float32).T, strict=True))
    left = np.linspace(-30, 30, 40)
    ahead = np.stack([np.full_like(left, 40.0), left, np.zeros_like(left)], axis=1)
    xyz = (LIDAR.inverse().rotation @ ahead.T).astype(np.float32)
    speed = (-SPEED_MPS * 40.0 / np.linalg.norm(ahead, axis=1)).astype(np.float32)
    return {**dict(zip("xyz", xyz, strict=True)), "radial_speed": speed}


def _odometry(reading: OdometryReading, stamp_ns: int) -> object:
    stamped = OdometryReading(stamp_ns, "odom", reading.child_frame_id, reading.pose, reading.linear, reading.angular)
    return encode_odometry(factory, stamped)


def _links(place: RigidTransform, stamp_ns: int) -> object:
    still = RigidTransform.identity()
    links = [StampedTransform("map", "odom", stamp_ns, still), StampedTransform("odom", "base", stamp_ns, place)]
    return encode_transforms(factory, links)
