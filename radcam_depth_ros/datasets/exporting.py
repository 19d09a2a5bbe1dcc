"""Writes drives as a data set in the schema of nuScenes: tables, samples, sweeps and a map; no annotation."""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_left
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.recorded import RecordedDrive, Sensor
from radcam_depth_ros.files import cannot_write, partial_folder
from radcam_depth_ros.geometry import RigidTransform

_TABLES = (
    *("category", "attribute", "visibility", "instance", "sensor", "calibrated_sensor", "ego_pose"),
    *("log", "scene", "sample", "sample_data", "sample_annotation", "map"),
)
_KEY_PERIOD_US = 500_000
_ENDINGS = {"camera": ".jpg", "radar": ".pcd", "lidar": ".pcd.bin"}
Row = dict[str, Any]


def export_nuscenes(
    bags: Sequence[Path],
    out: Path,
    *,
    version: str = "v1.0-mini",
    names: Sequence[str] = (),
    progress: Callable[[], None] = lambda: None,
) -> None:
    """Writes drives as scenes of a data set in the schema of nuScenes, whole or not at all.

    Args:
        bags: The drives.
        out: The data set's folder, which must not exist.
        version: Name of the tables' folder.
        names: Of the scenes; scene-0001 and so on where there are none.
        progress: Called after each drive.

    Raises:
        DatasetError: for a folder that is there, or a drive that lacks what nuScenes has.
        BagError: for a bag that cannot be read.
        FileError: when the files cannot be written.
    """
    if out.exists():
        raise DatasetError(f"expected a new folder for the data set, got {out}, which is there; choose another name")
    try:
        with partial_folder(out) as partial:
            tables = _Tables(partial / out.name)
            for index, bag in enumerate(bags):
                tables.add(RecordedDrive(bag), names[index] if names else f"scene-{index + 1:04d}")
                progress()
            tables.write(version)
            (partial / out.name).rename(out)
    except OSError as error:
        raise cannot_write(out, error) from None


class _Tables:
    """Rows of all tables; the files of readings are written at once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._rows: dict[str, list[Row]] = {name: [] for name in _TABLES}

    def add(self, drive: RecordedDrive, name: str) -> None:
        """Adds a drive as a scene."""
        scene, log = _token("scene", name), _token("log", name)
        location = drive.scenario.get("location", "simulated")
        self._add("log", log, logfile=name, vehicle="", date_captured="", location=location)
        samples = self._samples(scene, list(drive.sensors.values()))
        words = (value for key, value in drive.scenario.items() if key in ("time_of_day", "weather", "street"))
        self._add(
            "scene",
            scene,
            log_token=log,
            nbr_samples=len(samples),
            first_sample_token=samples[0]["token"],
            last_sample_token=samples[-1]["token"],
            name=name,
            description=drive.scenario.get("description") or ", ".join(words),
        )
        files = {}
        for sensor in drive.sensors.values():
            self._sensor(name, sensor)
            files.update(self._readings(name, sensor, samples, drive))
        for sensor, time_us, content in drive.files():
            path = self._root / files[sensor.channel, time_us]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)

    def write(self, version: str) -> None:
        """Writes the tables, and a map that covers every log."""
        mask = f"maps/{_token('map')}.png"
        (self._root / "maps").mkdir(parents=True)
        (self._root / mask).write_bytes(cv2.imencode(".png", np.zeros((20, 20), np.uint8))[1].tobytes())
        logs = [row["token"] for row in self._rows["log"]]
        self._add("map", _token("map"), log_tokens=logs, category="semantic_prior", filename=mask)
        folder = self._root / version
        folder.mkdir()
        for name, rows in self._rows.items():
            (folder / f"{name}.json").write_text(json.dumps(rows, indent=0) + "\n", encoding="utf-8")

    def _add(self, table: str, token: str, **values: object) -> Row:
        self._rows[table].append({"token": token, **values})
        return self._rows[table][-1]

    def _samples(self, scene: str, sensors: Sequence[Sensor]) -> list[Row]:
        """Key frames of 2 Hz while all sensors are read, at the times of LiDAR scans."""
        scans = next(sensor.time_us for sensor in sensors if sensor.modality == "lidar")
        wanted = max(sensor.time_us[0] for sensor in sensors)
        last = min(sensor.time_us[-1] for sensor in sensors)
        times: list[int] = []
        while wanted <= last or not times:
            times.append(scans[min(bisect_left(scans, wanted), len(scans) - 1)])
            wanted += _KEY_PERIOD_US
        times = sorted(set(times))
        tokens = ["", *(_token(scene, time_us) for time_us in times), ""]
        return [
            self._add("sample", token, timestamp=time_us, prev=before, next=after, scene_token=scene)
            for time_us, before, token, after in zip(times, tokens, tokens[1:], tokens[2:], strict=False)
        ]

    def _sensor(self, scene: str, sensor: Sensor) -> None:
        token = _token("sensor", sensor.channel)
        if all(row["token"] != token for row in self._rows["sensor"]):
            self._add("sensor", token, channel=sensor.channel, modality=sensor.modality)
        self._add(
            "calibrated_sensor",
            _token("calibrated", scene, sensor.channel),
            sensor_token=token,
            **_pose(sensor.ego_from_sensor),
            camera_intrinsic=sensor.camera.matrix.tolist() if sensor.camera else [],
        )

    def _readings(
        self, scene: str, sensor: Sensor, samples: Sequence[Row], drive: RecordedDrive
    ) -> dict[tuple[str, int], str]:
        """Adds a sensor's readings; gives back the file of each."""
        times, channel, files = np.array(sensor.time_us), sensor.channel, {}
        keys = {int(np.abs(times - sample["timestamp"]).argmin()): sample["token"] for sample in samples}
        sample_times = [sample["timestamp"] for sample in samples]
        tokens = ["", *(_token(scene, channel, time_us) for time_us in sensor.time_us), ""]
        for index, time_us in enumerate(sensor.time_us):
            following = samples[min(bisect_left(sample_times, time_us), len(samples) - 1)]
            folder, token = "samples" if index in keys else "sweeps", tokens[index + 1]
            file = f"{folder}/{channel}/{scene}__{channel}__{time_us}{_ENDINGS[sensor.modality]}"
            files[channel, time_us] = file
            pose = drive.poses.at(time_us * 1000)
            if pose is None:
                raise DatasetError(
                    f"expected odometry of {drive.path} at {time_us} us without a gap, got none; record it all the time"
                )
            self._add("ego_pose", token, timestamp=time_us, **_pose(pose))
            self._add(
                "sample_data",
                token,
                sample_token=keys.get(index, following["token"]),
                ego_pose_token=token,
                calibrated_sensor_token=_token("calibrated", scene, channel),
                timestamp=time_us,
                fileformat="jpg" if sensor.camera else "pcd",
                is_key_frame=index in keys,
                height=sensor.camera.height if sensor.camera else 0,
                width=sensor.camera.width if sensor.camera else 0,
                filename=file,
                prev=tokens[index],
                next=tokens[index + 2],
            )
        return files


def _token(*parts: object) -> str:
    return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def _pose(pose: RigidTransform) -> dict[str, list[float]]:
    x, y, z, w = pose.quaternion
    return {"translation": pose.translation.tolist(), "rotation": [w, x, y, z]}
