"""The tables of a data set in the schema of nuScenes, and what they say of each scene.

Two tables have a row for each of millions of readings. They are read row by row, and of the scenes that are asked for
columns are kept, some 150 bytes a reading.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import DatasetLayout, ImportOptions
from radcam_depth_ros.datasets.rows import read_rows

_FIELDS = {
    "scene": ("token", "name", "description", "log_token"),
    "sample": ("token", "scene_token"),
    "sensor": ("token", "channel", "modality"),
    "calibrated_sensor": ("token", "sensor_token", "translation", "rotation", "camera_intrinsic"),
    "sample_data": (
        *("sample_token", "ego_pose_token", "calibrated_sensor_token", "filename", "timestamp", "is_key_frame"),
        *("width", "height"),
    ),
    "ego_pose": ("token", "timestamp", "translation", "rotation"),
}
_POSE_VALUES = 7
_REPORTED_ROWS = 10_000
_FILE_NAME = re.compile(r"\w[\w.-]{0,200}", re.ASCII)


@dataclass(frozen=True)
class Scene:
    """A row of scene.json.

    Attributes:
        token: Its key.
        name: Such as scene-0061.
        description: What is to be seen, in words.
        location: Where; empty where the data set does not say.
    """

    token: str
    name: str
    description: str
    location: str


@dataclass(frozen=True)
class Mounted:
    """A sensor as it is calibrated for a scene.

    Attributes:
        channel: Such as CAM_FRONT.
        modality: camera, radar or lidar.
        pose: x y z in metres and the quaternion w x y z: the sensor in the ego frame.
        intrinsic: The camera's matrix row by row, 9 values; empty of other sensors.
    """

    channel: str
    modality: str
    pose: tuple[float, ...]
    intrinsic: tuple[float, ...]


@dataclass(frozen=True)
class SceneRecords:
    """All that the tables say of a scene's readings.

    Attributes:
        scene: The scene.
        sensors: The sensors whose readings are taken.
        sensor: (N,) int64, each reading's place in `sensors`.
        time_us: (N,) int64, ascending.
        is_key: (N,) bool.
        sample: (N,) int64, the same for the readings of one sample.
        size: (N, 2) int64 width and height of images in pixels.
        files: N paths below the data set's folder.
        pose_time_us: (P,) int64, ascending, each once; empty where a reading has no pose.
        poses: (P, 7) float64, the ego frame in the global one: x y z in metres and the quaternion w x y z.
    """

    scene: Scene
    sensors: tuple[Mounted, ...]
    sensor: npt.NDArray[np.int64]
    time_us: npt.NDArray[np.int64]
    is_key: npt.NDArray[np.bool_]
    sample: npt.NDArray[np.int64]
    size: npt.NDArray[np.int64]
    files: tuple[str, ...]
    pose_time_us: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]


class Tables:
    """The tables of one version of a data set.

    Args:
        root: The data set's folder.
        version: Name of the tables' folder.

    Attributes:
        scenes: All scenes in the order of the table.

    Raises:
        DatasetError: for a folder or tables that are not there, or those of another set.
    """

    def __init__(self, root: Path, version: str) -> None:
        self._root, self.version = root, version
        self._folder = root / version
        if not (self._folder / "sample_data.json").is_file():
            there = sorted(path.parent.name for path in root.glob("*/sample_data.json")) if root.is_dir() else []
            raise DatasetError(
                f"expected tables such as sample_data.json in {self._folder}, got none; {root} has those of "
                f"{', '.join(there) or 'no version'}: give the data set's folder, and --version"
            )
        places: dict[str, str] = {}
        with _usable(self._folder):
            if (self._folder / "log.json").is_file():  # not all sets tell where they were recorded
                places = {row["token"]: str(row["location"]) for row in self._rows("log", ("token", "location"))}
            self.scenes = tuple(
                Scene(row["token"], str(row["name"]), str(row["description"]), places.get(row["log_token"], ""))
                for row in self._rows("scene")
            )
        for scene in self.scenes:
            if not _FILE_NAME.fullmatch(scene.name):
                raise DatasetError(
                    f"expected scenes whose names can be files in {self._folder}, got {scene.name[:60]!r}"
                )

    def records(
        self,
        scenes: Sequence[Scene],
        layout: DatasetLayout,
        options: ImportOptions,
        tick: Callable[[int], None] = lambda rows: None,
    ) -> Iterator[SceneRecords]:
        """What the tables say of some scenes, in their order; both large tables are read once.

        Args:
            scenes: Of `scenes`.
            layout: Which data set it is.
            options: Which readings are taken.
            tick: Called now and then with the number of rows of the large tables that were read since.

        Raises:
            DatasetError: for tables that do not fit together.
        """
        with _usable(self._folder):
            order = {scene.token: index for index, scene in enumerate(scenes)}
            samples = {
                row["token"]: order[row["scene_token"]] for row in self._rows("sample") if row["scene_token"] in order
            }
            sensors = self._sensors()
            self._require_channels(sensors.values(), layout, options)
            readings = _Readings(sensors, layout, options)
            for row in self._counted("sample_data", tick):
                index = samples.get(row["sample_token"])
                if index is not None:
                    readings.add(index, row)
            poses = _Poses(set(readings.poses))
            for row in self._counted("ego_pose", tick):
                poses.add(row)
            poses.finish()
        for part, scene in zip(readings.by_scene(len(scenes)), scenes, strict=True):
            yield readings.records(scene, part, poses)

    def _rows(self, table: str, fields: tuple[str, ...] = ()) -> Iterator[dict[str, Any]]:
        return read_rows(self._folder / f"{table}.json", fields or _FIELDS[table])

    def _counted(self, table: str, tick: Callable[[int], None]) -> Iterator[dict[str, Any]]:
        count = 0
        for row in self._rows(table):
            yield row
            count += 1
            if count == _REPORTED_ROWS:
                tick(count)
                count = 0
        tick(count)

    def _sensors(self) -> dict[str, Mounted]:
        kinds = {row["token"]: (str(row["channel"]), str(row["modality"])) for row in self._rows("sensor")}
        found = {}
        for row in self._rows("calibrated_sensor"):
            if row["sensor_token"] not in kinds:
                raise DatasetError(
                    f"expected a sensor of each calibrated_sensor in {self._folder}, got the unknown "
                    f"{row['sensor_token']!r}; unpack the metadata anew"
                )
            pose = (*map(float, row["translation"]), *map(float, row["rotation"]))
            intrinsic = tuple(float(value) for line in row["camera_intrinsic"] for value in line)
            found[row["token"]] = Mounted(*kinds[row["sensor_token"]], pose, intrinsic)
        return found

    def _require_channels(self, sensors: Any, layout: DatasetLayout, options: ImportOptions) -> None:
        there = sorted({sensor.channel for sensor in sensors})
        wanted = [*options.channels(layout), layout.radar, layout.lidar]
        missing = [channel for channel in wanted if channel not in there]
        if missing:
            raise DatasetError(
                f"expected the sensors {', '.join(wanted)} of {layout.title} in {self._folder}, got "
                f"{', '.join(there) or 'none'}; check --cameras, and which data set it is"
            )


@contextmanager
def _usable(folder: Path) -> Iterator[None]:
    """Around what takes values of rows: a value of another type is a fault of the tables."""
    try:
        yield
    except (TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DatasetError(
            f"expected tables in the schema of nuScenes in {folder}, got a value that cannot be used ({error}); unpack "
            "the metadata anew"
        ) from None


class _Readings:
    """Columns of sample_data, of the scenes that are asked for."""

    def __init__(self, sensors: Mapping[str, Mounted], layout: DatasetLayout, options: ImportOptions) -> None:
        self._sensors = tuple(sensors.values())
        self._places = {token: index for index, token in enumerate(sensors)}
        self._taken = [options.takes(layout, sensor.channel, sensor.modality) for sensor in self._sensors]
        self._images = options.images
        self._scene, self._time, self._sensor = array("i"), array("q"), array("i")
        self._key, self._width, self._height = array("b"), array("i"), array("i")
        self._sample, self._names, self._ends = array("q"), bytearray(), array("q")
        self.poses = array("q")
        """Keys of the poses of all readings, those that are not taken too."""

    def add(self, scene: int, row: Mapping[str, Any]) -> None:
        """Takes a row."""
        sensor = self._places.get(row["calibrated_sensor_token"])
        if sensor is None:
            raise DatasetError(
                f"expected a calibrated_sensor of each sample_data, got none for {row['filename']}; unpack the "
                "metadata anew"
            )
        is_taken = self._taken[sensor]
        if is_taken and self._images == "keyframes" and self._sensors[sensor].modality == "camera":
            is_taken = bool(row["is_key_frame"])
        self._scene.append(scene)
        self._time.append(row["timestamp"])
        self._sensor.append(sensor if is_taken else -1)
        self._key.append(bool(row["is_key_frame"]))
        self._sample.append(hash(row["sample_token"]))
        self._width.append(row["width"] or 0)
        self._height.append(row["height"] or 0)
        if is_taken:
            self._names += row["filename"].encode()
        self._ends.append(len(self._names))
        self.poses.append(hash(row["ego_pose_token"]))

    def by_scene(self, scenes: int) -> Iterator[npt.NDArray[np.int64]]:
        """The rows of each scene, by their times."""
        scene, time = np.frombuffer(self._scene, np.int32), np.frombuffer(self._time, np.int64)
        order = np.lexsort((time, scene))
        bounds = np.searchsorted(scene[order], np.arange(scenes + 1))
        for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            yield order[first:last]

    def records(self, scene: Scene, rows: npt.NDArray[np.int64], poses: _Poses) -> SceneRecords:
        """One scene."""
        pose_time_us, pose = poses.of(np.frombuffer(self.poses, np.int64)[rows])
        sensor = np.frombuffer(self._sensor, np.int32)
        rows = rows[sensor[rows] >= 0]
        used, places = np.unique(sensor[rows], return_inverse=True)
        size = np.stack([np.frombuffer(column, np.int32)[rows] for column in (self._width, self._height)], axis=1)
        return SceneRecords(
            scene,
            tuple(self._sensors[index] for index in used.tolist()),
            places.astype(np.int64),
            np.frombuffer(self._time, np.int64)[rows],
            np.frombuffer(self._key, np.int8)[rows].astype(np.bool_),
            np.frombuffer(self._sample, np.int64)[rows],
            size.astype(np.int64),
            tuple(self._file(row) for row in rows.tolist()),
            pose_time_us,
            pose,
        )

    def _file(self, row: int) -> str:
        return self._names[self._ends[row - 1] if row else 0 : self._ends[row]].decode()


class _Poses:
    """Columns of ego_pose: those that readings name, by the hash of their tokens."""

    def __init__(self, wanted: set[int]) -> None:
        self._wanted = wanted
        self._keys, self._times, self._values = array("q"), array("q"), array("d")
        self._order: npt.NDArray[np.int64] = np.zeros(0, np.int64)
        self._sorted: npt.NDArray[np.int64] = np.zeros(0, np.int64)

    def add(self, row: Mapping[str, Any]) -> None:
        """Takes a row."""
        key = hash(row["token"])
        if key not in self._wanted:
            return
        if len(row["translation"]) + len(row["rotation"]) != _POSE_VALUES:
            raise DatasetError(f"expected 3 numbers and 4 of the ego_pose {row['token']}; unpack the metadata anew")
        self._keys.append(key)
        self._times.append(row["timestamp"])
        self._values.extend(row["translation"])
        self._values.extend(row["rotation"])

    def finish(self) -> None:
        """No row comes any more."""
        self._wanted = set()
        keys = np.frombuffer(self._keys, np.int64)
        self._order = np.argsort(keys, kind="stable")
        self._sorted = keys[self._order]

    def of(self, keys: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """The times and poses of some keys, by time, each time once; none where the table lacks one of them."""
        if not np.isin(keys, self._sorted).all() or not len(keys):
            return np.zeros(0, np.int64), np.zeros((0, _POSE_VALUES))
        place = np.searchsorted(self._sorted, keys)
        rows = self._order[place]
        times, first = np.unique(np.frombuffer(self._times, np.int64)[rows], return_index=True)
        return times, np.frombuffer(self._values, np.float64).reshape(-1, _POSE_VALUES)[rows[first]]
