"""Prepared samples of a drive on disk, read through memory maps: no decoding while a network trains.

A cached drive is a folder of raw arrays, one a kind, with a description beside them:

- `image.raw` (F, H, W, 3) uint8 RGB at the network's focal length;
- `depth.raw` (F, H, W) float16 metres, NaN unknown, +inf sky (half precision: 0.05 % of the depth);
- `classes.raw` (F, H, W) uint8, 255 unknown; only where the bag has them;
- `radar.npy` (M, 6) float32, `radar_source.npy` (M,) uint8, `radar_start.npy` (F + 1,) int64: all points in a row;
- `ground.npy` (F, 4) float64: height and normal of the road; `stamp_ns.npy` (F,) int64;
- `drive.json`: see `DriveCard`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane, ImageArray, RadcamDepthError

FORMAT_VERSION = 2
"""Counts changes of the layout above, and of how images are resampled; a cache of another version is built again."""

RADAR_COLUMNS = 6
"""u px, v px, depth m, rcs dBsm, radial speed m/s, age s: what networks are given, NaN where unknown."""

UNKNOWN_CLASS = 255


class TrainingError(RadcamDepthError):
    """Training data, a run folder or a recipe that cannot be used, or training that went astray."""


@dataclass(frozen=True)
class TrainingSample:
    """One frame with ground truth, at the network's focal length.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        depth_m: (H, W) float16 metres; NaN unknown, +inf sky.
        classes: (H, W) uint8, 255 unknown.
        radar: (N, 6) float32: u px, v px, depth m, rcs dBsm, radial speed m/s, age s; NaN unknown.
        radar_source: (N,) uint8, which radar a point is of.
        camera: The camera of these images.
        ground: The flat road.
    """

    image: ImageArray
    depth_m: npt.NDArray[np.float16]
    classes: npt.NDArray[np.uint8]
    radar: FloatArray
    radar_source: npt.NDArray[np.uint8]
    camera: CameraModel
    ground: GroundPlane


@dataclass(frozen=True)
class DriveCard:
    """What a cached drive was made from and holds.

    Attributes:
        version: Of the layout.
        source: The bag's path.
        source_size: Its size in bytes and `source_mtime_ns` its time of change: a bag that changed is read again.
        source_mtime_ns: See `source_size`.
        settings: What the samples were made with.
        frames: Number of samples.
        camera: The network's camera: its size is that of the images.
        radars: Names of the radars, in the order of their source index.
        has_classes: Whether there are class images.
    """

    version: int
    source: str
    source_size: int
    source_mtime_ns: int
    settings: Mapping[str, Any]
    frames: int
    camera: CameraModel
    radars: tuple[str, ...]
    has_classes: bool

    def write(self, path: Path) -> None:
        """Writes the card as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> DriveCard:
        """Reads a card.

        Raises:
            TrainingError: when it is missing or damaged.
        """
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            values["camera"] = CameraModel(**values["camera"])
            values["radars"] = tuple(values["radars"])
            return cls(**values)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise TrainingError(f"{path} does not describe a cached drive ({error}); delete its folder") from None


class CachedDrive:
    """The samples of one bag, memory-mapped: opening costs nothing, a sample costs the pages that are touched."""

    def __init__(self, folder: Path) -> None:
        self.card = DriveCard.read(folder / "drive.json")
        height, width = self.card.camera.height, self.card.camera.width
        shape = (self.card.frames, height, width)
        try:
            self._image = _map(folder / "image.raw", np.uint8, (*shape, 3))
            self._depth = _map(folder / "depth.raw", np.float16, shape)
            self._classes = _map(folder / "classes.raw", np.uint8, shape) if self.card.has_classes else None
            self._radar = np.load(folder / "radar.npy")
            self._radar_source = np.load(folder / "radar_source.npy")
            self._radar_start = np.load(folder / "radar_start.npy")
            self._ground = np.load(folder / "ground.npy")
            self.stamps_ns: npt.NDArray[np.int64] = np.load(folder / "stamp_ns.npy")
        except (OSError, ValueError) as error:
            raise TrainingError(f"the cached drive {folder} is damaged ({error}); delete it") from None

    def __len__(self) -> int:
        return self.card.frames

    def __getitem__(self, index: int) -> TrainingSample:
        if not 0 <= index < len(self):
            raise IndexError(index)
        points = slice(int(self._radar_start[index]), int(self._radar_start[index + 1]))
        height_m, *up = (float(value) for value in self._ground[index])
        if self._classes is None:
            classes = np.broadcast_to(np.uint8(UNKNOWN_CLASS), self._depth.shape[1:])
        else:
            classes = self._classes[index]
        return TrainingSample(
            image=self._image[index],
            depth_m=self._depth[index],
            classes=classes,
            radar=self._radar[points],
            radar_source=self._radar_source[points],
            camera=self.card.camera,
            ground=GroundPlane(height_m, (up[0], up[1], up[2])),
        )


def _map(path: Path, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    mapped = np.memmap(path, dtype=dtype, mode="r", shape=shape)
    # A plain view: indexing np.memmap itself costs a Python-level __array_finalize__ each time.
    return np.asarray(mapped)
