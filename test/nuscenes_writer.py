"""Writes drives as a data set in the schema of nuScenes: tables, samples, sweeps and a map."""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.bags import BagReader, read_scenario, read_static_transforms
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import Calibration, decode_odometry, stamp_ns
from radcam_depth_ros.messages.clouds import Cloud
from radcam_depth_ros.motion.poses import Poses

VERSION = "v1.0-mini"
KEY_PERIOD_US = 500_000
TABLES = (
    *("category", "attribute", "visibility", "instance", "sensor", "calibrated_sensor", "ego_pose"),
    *("log", "scene", "sample", "sample_data", "sample_annotation", "map"),
)
EGO = "base_footprint"
_FOLDERS = {"camera": ".jpg", "radar": ".pcd", "lidar": ".pcd.bin"}
_PCD_TYPES = {"f4": (4, "F"), "i1": (1, "I"), "i2": (2, "I"), "i4": (4, "I"), "u1": (1, "U"), "f8": (8, "F")}


@dataclass
class NuscenesWriter:
    """A data set that drives are added to, each as a scene; `close` writes its tables.

    Attributes:
        root: The data set's folder.
        version: Name of the tables' folder.
        tables: Rows by the tables' names.
    """

    root: Path
    version: str = VERSION
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=lambda: {name: [] for name in TABLES})

    def add_drive(self, bag: Path, name: str, location: str = "boston-seaport") -> None:
        """Writes a drive's files, and adds its rows.

        Topics are /camera/NAME/image_raw/compressed, /radar/NAME/points and /lidar/points; without a name, `front`.
        """
        records, tree, poses, scenario = _read(bag)
        scene, log = self._token("scene", name), self._token("log", name)
        self.tables["log"].append(
            {"token": log, "logfile": name, "vehicle": "n000", "date_captured": "2018-01-01", "location": location}
        )
        samples = self._add_samples(scene, records)
        words = [value for value in scenario.values() if value in ("night", "rain")]
        self.tables["scene"].append(
            {
                "token": scene,
                "log_token": log,
                "nbr_samples": len(samples),
                "first_sample_token": samples[0]["token"],
                "last_sample_token": samples[-1]["token"],
                "name": name,
                "description": ", ".join(['Parked cars {a "quoted" brace}', *(word.title() for word in words)]),
            }
        )
        for channel, readings in sorted(records.items()):
            calibrated = self._add_sensor(name, channel, readings[0], tree)
            self._add_data(name, channel, readings, samples, calibrated, poses)

    def close(self) -> Path:
        """Writes all tables, and a map that covers every log; gives back the data set's folder."""
        mask = f"maps/{self._token('map', '')}.png"
        (self.root / "maps").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(self.root / mask), np.zeros((20, 20), np.uint8))
        logs = [row["token"] for row in self.tables["log"]]
        record = {"token": self._token("map", ""), "log_tokens": logs, "category": "semantic_prior", "filename": mask}
        self.tables["map"] = [record]
        folder = self.root / self.version
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in self.tables.items():
            (folder / f"{name}.json").write_text(json.dumps(rows, indent=0), encoding="utf-8")
        return self.root

    def _token(self, *parts: object) -> str:
        return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()

    def _add_samples(self, scene: str, records: dict[str, list[_Reading]]) -> list[dict[str, Any]]:
        times = [reading.time_us for reading in records["LIDAR_TOP"]]
        last = min(readings[-1].time_us for readings in records.values())
        chosen = []
        wanted = max(readings[0].time_us for readings in records.values())
        while wanted <= last:
            chosen.append(times[min(bisect_left(times, wanted), len(times) - 1)])
            wanted += KEY_PERIOD_US
        tokens = ["", *(self._token(scene, time_us) for time_us in chosen), ""]
        rows = [
            {"token": token, "timestamp": time_us, "prev": before, "next": after, "scene_token": scene}
            for time_us, before, token, after in zip(chosen, tokens, tokens[1:], tokens[2:], strict=False)
        ]
        self.tables["sample"] += rows
        return rows

    def _add_sensor(self, scene: str, channel: str, reading: _Reading, tree: TransformTree) -> str:
        sensor, token = self._token("sensor", channel), self._token("calibrated", scene, channel)
        if all(row["token"] != sensor for row in self.tables["sensor"]):
            self.tables["sensor"].append({"token": sensor, "channel": channel, "modality": reading.kind})
        intrinsic = [] if reading.matrix is None else reading.matrix.tolist()
        pose = tree.lookup(EGO, reading.frame_id)
        row = {"token": token, "sensor_token": sensor, **_pose_row(pose), "camera_intrinsic": intrinsic}
        self.tables["calibrated_sensor"].append(row)
        return token

    def _add_data(
        self,
        scene: str,
        channel: str,
        readings: list[_Reading],
        samples: list[dict[str, Any]],
        calibrated: str,
        poses: Poses,
    ) -> None:
        times = np.array([reading.time_us for reading in readings])
        key = {int(np.abs(times - sample["timestamp"]).argmin()): sample["token"] for sample in samples}
        sample_times = [sample["timestamp"] for sample in samples]
        tokens = ["", *(self._token(scene, channel, reading.time_us) for reading in readings), ""]
        for index, reading in enumerate(readings):
            following = min(bisect_left(sample_times, reading.time_us), len(samples) - 1)
            folder = "samples" if index in key else "sweeps"
            name = f"{folder}/{channel}/{scene}__{channel}__{reading.time_us}{_FOLDERS[reading.kind]}"
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            (self.root / name).write_bytes(reading.content)
            pose = poses.at(reading.time_us * 1000)
            assert pose is not None
            token = tokens[index + 1]
            self.tables["ego_pose"].append({"token": token, "timestamp": reading.time_us, **_pose_row(pose)})
            self.tables["sample_data"].append(
                {
                    "token": token,
                    "sample_token": key.get(index, samples[following]["token"]),
                    "ego_pose_token": token,
                    "calibrated_sensor_token": calibrated,
                    "timestamp": reading.time_us,
                    "fileformat": "jpg" if reading.kind == "camera" else "pcd",
                    "is_key_frame": index in key,
                    "height": reading.size[0],
                    "width": reading.size[1],
                    "filename": name,
                    "prev": tokens[index],
                    "next": tokens[index + 2],
                }
            )


def write_nuscenes(
    root: Path, drives: Sequence[Path], version: str = VERSION, names: Sequence[str] | None = None
) -> Path:
    """Writes drives as scene-0001 and so on, or under some names; gives back the data set's folder."""
    writer = NuscenesWriter(root, version)
    for index, bag in enumerate(drives):
        writer.add_drive(bag, names[index] if names else f"scene-{index + 1:04d}")
    return writer.close()


@dataclass(frozen=True)
class _Reading:
    time_us: int
    kind: str
    frame_id: str
    content: bytes
    size: tuple[int, int] = (0, 0)
    matrix: np.ndarray | None = None


def _read(bag: Path) -> tuple[dict[str, list[_Reading]], TransformTree, Poses, dict[str, str]]:
    records: dict[str, list[_Reading]] = {}
    poses = Poses()
    with BagReader(bag) as reader:
        tree, scenario = read_static_transforms(reader), dict(read_scenario(reader))
        infos = {}
        for item in reader.messages():
            parts, message = item.topic.strip("/").split("/"), item.message
            if parts[-1] == "camera_info" and parts[0] == "camera":
                infos.setdefault(parts[1] if len(parts) == 3 else "front", Calibration(message).camera)
        for item in reader.messages():
            parts, message = item.topic.strip("/").split("/"), item.message
            if item.topic == "/odom":
                poses.add(stamp_ns(message.header), decode_odometry(message).pose)
            elif parts[-2:] == ["image_raw", "compressed"]:
                name = parts[1] if len(parts) == 4 else "front"
                camera = infos[name]
                size = (camera.height, camera.width)
                reading = _reading(message, "camera", bytes(message.data), size, camera.matrix)
                records.setdefault(f"CAM_{name.upper()}", []).append(reading)
            elif parts[0] == "radar" and parts[-1] == "points":
                name = parts[1] if len(parts) == 3 else "front"
                reading = _reading(message, "radar", radar_file(message))
                records.setdefault(f"RADAR_{name.upper()}", []).append(reading)
            elif parts[0] == "lidar":
                records.setdefault("LIDAR_TOP", []).append(_reading(message, "lidar", lidar_file(message)))
    span = poses.span_ns
    assert span is not None
    for channel, readings in records.items():
        records[channel] = [item for item in readings if span[0] <= item.time_us * 1000 <= span[1]]
    return records, tree, poses, scenario


def _reading(
    message: Any, kind: str, content: bytes, size: tuple[int, int] = (0, 0), matrix: np.ndarray | None = None
) -> _Reading:
    return _Reading(stamp_ns(message.header) // 1000, kind, str(message.header.frame_id), content, size, matrix)


def _pose_row(pose: RigidTransform) -> dict[str, list[float]]:
    x, y, z, w = pose.quaternion
    return {"translation": pose.translation.tolist(), "rotation": [w, x, y, z]}


def lidar_file(message: Any) -> bytes:
    """float32 x y z intensity ring, point by point."""
    cloud = Cloud(message)
    columns = [cloud.find((name,)) for name in ("x", "y", "z", "intensity", "ring")]
    values = [np.zeros(cloud.count, np.float32) if field is None else cloud.floats(field) for field in columns]
    return np.stack(values, axis=1).astype("<f4").tobytes()


def radar_file(message: Any) -> bytes:
    """A binary PCD of a cloud's own fields; no return is one point of NaN."""
    cloud = Cloud(message)
    fields = [cloud.find((str(item.name),)) for item in cloud.fields]
    columns = {item.name: cloud.column(item) for item in fields if item is not None}
    return pcd_file(columns)


def pcd_file(columns: dict[str, np.ndarray], data: str = "binary") -> bytes:
    """A PCD of columns (N,); of no point one that is NaN, with a byte after the last point as nuScenes' have it."""
    kinds = {name: column.dtype.str[1:] for name, column in columns.items()}
    points = np.zeros(max(len(next(iter(columns.values()))), 1), list(kinds.items()))
    if len(next(iter(columns.values()))):
        for name, column in columns.items():
            points[name] = column
    else:
        for name, kind in kinds.items():
            if kind[0] == "f":
                points[name] = np.nan
    sizes, types = zip(*(_PCD_TYPES[kind] for kind in kinds.values()), strict=True)
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(map(str, sizes))}",
        f"TYPE {' '.join(types)}",
        f"COUNT {' '.join('1' for _ in columns)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        f"DATA {data}",
    )
    return ("\n".join(lines) + "\n").encode() + points.tobytes() + b"\0"
