"""Writes one scene of a data set as a bag."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import SCENARIO_TOPIC, BagWriter, factory
from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import LAYOUTS, WORLD_FRAME, DatasetLayout
from radcam_depth_ros.datasets.tables import Mounted, SceneRecords
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import GeometryError, RigidTransform
from radcam_depth_ros.messages import (
    OdometryReading,
    StampedTransform,
    encode_camera_info,
    encode_jpeg_file,
    encode_odometry,
    encode_points,
    encode_transforms,
)

_US_NS = 1_000
_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_FASTEST_MPS, _JITTER_M = 100.0, 1.0
"""No vehicle is faster than this over some metres: there the ego pose jumps."""
_SPEED_US = 50_000
"""The vehicle's speed is that over so long before and after."""


@dataclass(frozen=True)
class SceneImport:
    """A scene to write.

    Attributes:
        root: The data set's folder.
        layout: Name of the data set, of `LAYOUTS`.
        version: Name of the tables' folder.
        split: The scene's official split; empty where there is none.
        made_with: The options in one line.
        records: The scene.
        out: The bag.
        overwrite: Replace a bag that is there.
    """

    root: Path
    layout: str
    version: str
    split: str
    made_with: str
    records: SceneRecords
    out: Path
    overwrite: bool


def write_scene(job: SceneImport) -> None:
    """Writes a scene's bag, whole or not at all; one file of the scene is held at a time.

    Raises:
        DatasetError: for a file that is missing or cannot be read, a calibration that is none, or poses that jump.
        BagError: when the bag cannot be written.
    """
    records, layout = job.records, LAYOUTS[job.layout]
    if not len(records.time_us) or not len(records.pose_time_us):
        raise DatasetError(
            f"expected readings in {records.scene.name} and an ego_pose of each, got none of some; unpack the metadata "
            "anew"
        )
    poses = _poses(records)
    mounts = [_transform(sensor.pose, f"{sensor.channel} of {records.scene.name}") for sensor in records.sensors]
    with BagWriter(job.out, latched=("/tf_static", SCENARIO_TOPIC), overwrite=job.overwrite) as writer:
        start_us = min(int(records.time_us[0]), int(records.pose_time_us[0]))
        links = [
            StampedTransform(layout.ego_frame, frame_of(sensor.channel), start_us * _US_NS, pose)
            for sensor, pose in zip(records.sensors, mounts, strict=True)
        ]
        writer.write("/tf_static", encode_transforms(factory, links), start_us * _US_NS)
        scenario = json.dumps(_scenario(job))
        writer.write(SCENARIO_TOPIC, factory("std_msgs/msg/String", data=scenario), start_us * _US_NS)
        odometry = _odometry(records, poses, layout.ego_frame)
        for index, time_us in enumerate(records.time_us.tolist()):
            while odometry and odometry[-1].stamp_ns <= time_us * _US_NS:
                _write_odometry(writer, odometry.pop())
            _write_reading(writer, job, layout, index)
        while odometry:
            _write_odometry(writer, odometry.pop())


def frame_of(channel: str) -> str:
    """The frame of a channel."""
    return channel.lower()


def _write_reading(writer: BagWriter, job: SceneImport, layout: DatasetLayout, index: int) -> None:
    records = job.records
    sensor, name = records.sensors[int(records.sensor[index])], records.files[index]
    stamp_ns, frame = int(records.time_us[index]) * _US_NS, frame_of(sensor.channel)
    content, topic = _content(job.root, name), layout.topic(sensor.channel, sensor.modality)
    if sensor.modality != "camera":
        read = layout.read_radar if sensor.modality == "radar" else layout.read_lidar
        writer.write(f"{topic}/points", encode_points(factory, read(content, name), stamp_ns, frame), stamp_ns)
        return
    if not content.startswith(_JPEG_START) or _JPEG_END not in content:
        raise DatasetError(f"expected a whole JPEG in {name}, got {len(content)} bytes of none; copy the file anew")
    width, height = records.size[index].tolist()
    camera = _camera(sensor, width, height)
    writer.write(f"{topic}/image_raw/compressed", encode_jpeg_file(factory, content, stamp_ns, frame), stamp_ns)
    writer.write(f"{topic}/camera_info", encode_camera_info(factory, camera, stamp_ns, frame), stamp_ns)


def _content(root: Path, name: str) -> bytes:
    path = root / name
    try:
        if not path.resolve().is_relative_to(root.resolve()):
            raise DatasetError(f"expected files within {root}, got {name!r}; unpack the metadata anew")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a name may be none
        reason = error.strerror if isinstance(error, OSError) else error
        raise DatasetError(
            f"expected the file {name!r} in {root}: {reason}; unpack all parts of the data set there, sweeps too"
        ) from None


def _camera(sensor: Mounted, width: int, height: int) -> CameraModel:
    if len(sensor.intrinsic) != 9 or width < 1 or height < 1:
        raise DatasetError(
            f"expected a matrix of 3 x 3 and a size in pixels of {sensor.channel}, got {len(sensor.intrinsic)} values "
            f"and {width} x {height}; unpack the metadata anew"
        )
    fx, skew, cx, _, fy, cy, *_ = sensor.intrinsic
    if abs(skew) > 1e-3:
        raise DatasetError(f"expected a camera without skew, got {skew} of {sensor.channel}; its images cannot be used")
    return CameraModel(width, height, fx, fy, cx, cy)


def _transform(pose: tuple[float, ...], what: str) -> RigidTransform:
    x, y, z, qw, qx, qy, qz = pose
    try:
        return RigidTransform.from_quaternion([x, y, z], [qx, qy, qz, qw])
    except GeometryError as error:
        raise DatasetError(f"the place of {what} cannot be used: {error}") from None


def _poses(records: SceneRecords) -> list[RigidTransform]:
    """The scene's poses; DatasetError where they jump."""
    moved = np.linalg.norm(np.diff(records.poses[:, :3], axis=0), axis=1)
    seconds = np.diff(records.pose_time_us) / 1e6
    jumps = np.flatnonzero(~(moved <= _FASTEST_MPS * seconds + _JITTER_M))
    if len(jumps):
        first = int(jumps[0])
        raise DatasetError(
            f"expected a vehicle that drives in {records.scene.name}, got an ego_pose that jumps "
            f"{moved[first]:.1f} m in {seconds[first]:.3f} s at {int(records.pose_time_us[first + 1])} us; leave the "
            "scene out"
        )
    return [_transform(tuple(pose), f"the vehicle in {records.scene.name}") for pose in records.poses.tolist()]


def _odometry(records: SceneRecords, poses: list[RigidTransform], ego_frame: str) -> list[OdometryReading]:
    """The vehicle's motion, the last one first."""
    times = records.pose_time_us
    before = np.searchsorted(times, times - _SPEED_US)
    after = np.minimum(np.searchsorted(times, times + _SPEED_US), len(times) - 1)
    readings = []
    for index, (first, last) in enumerate(zip(before.tolist(), after.tolist(), strict=True)):
        linear, angular = np.zeros(3), np.zeros(3)
        if last > first:
            seconds = float(times[last] - times[first]) / 1e6
            moved = poses[last].translation - poses[first].translation
            linear = poses[index].rotation.T @ moved / seconds
            turned = poses[first].rotation.T @ poses[last].rotation
            # Of the small turn within a tenth of a second, the part that is not symmetric.
            angular = np.array([turned[2, 1], turned[0, 2], turned[1, 0]]) - [turned[1, 2], turned[2, 0], turned[0, 1]]
            angular = angular / (2 * seconds)
        stamp_ns = int(times[index]) * _US_NS
        readings.append(OdometryReading(stamp_ns, WORLD_FRAME, ego_frame, poses[index], linear, angular))
    return readings[::-1]


def _write_odometry(writer: BagWriter, reading: OdometryReading) -> None:
    writer.write("/odom", encode_odometry(factory, reading), reading.stamp_ns)


def _scenario(job: SceneImport) -> dict[str, object]:
    scene, layout = job.records.scene, LAYOUTS[job.layout]
    description = scene.description.lower()
    return {
        "dataset": layout.title,
        "version": job.version,
        "scene": scene.name,
        "split": job.split,
        "location": scene.location,
        "description": scene.description,
        # By the words of the description, as published evaluations group the scenes.
        "time_of_day": "night" if "night" in description else "day",
        "weather": "rain" if "rain" in description else "dry",
        "imported": job.made_with,
        "radar": f"{layout.topic(layout.radar, 'radar')}/points",
        "key_frames": _key_frames(job.records, layout),
    }


def _key_frames(records: SceneRecords, layout: DatasetLayout) -> list[dict[str, int]]:
    """Of each key frame the stamps of its readings in nanoseconds, by their topics."""
    frames: dict[int, dict[str, int]] = {}
    for index in np.flatnonzero(records.is_key).tolist():
        sensor = records.sensors[int(records.sensor[index])]
        content = "image_raw/compressed" if sensor.modality == "camera" else "points"
        topic = f"{layout.topic(sensor.channel, sensor.modality)}/{content}"
        frames.setdefault(int(records.sample[index]), {})[topic] = int(records.time_us[index]) * _US_NS
    return list(frames.values())
