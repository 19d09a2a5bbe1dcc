"""Prepared samples of a drive on disk: no decoding while a network trains, and no more memory than a sample takes.

A cached drive is a folder of three files:

- `samples.raw`: the samples one after the other, each a row of arrays: image (H, W, 3) uint8 RGB at the network's focal
  length; depth (H, W) float16 metres, NaN unknown, +inf sky (half precision: 0.05 % of the depth); classes (H, W)
  uint8, 255 unknown, only where the bag has them; returns (N, 6) float32; of a single scan the pixels (S,) uint32 and
  their depths (S,) float16; the radar of each return (N,) uint8.
- `index.npy`: where each begins, how many returns and pixels it has, its road and its stamp, see `INDEX`;
- `drive.json`: see `DriveCard`.

A sample is read in one go, from a file that is open for that time alone: a data set has as many drives as it likes, and
a file that somebody cut short is an error and no crash, as it would be with a memory map.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.drive import ScanSummary
from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane, ImageArray
from radcam_depth_ros.training.errors import TrainingError

ValueT = TypeVar("ValueT", bound=np.generic)

FORMAT_VERSION = 7
"""Counts changes of the layout above, of how images are resampled, and of how ground truth is made: from 4 on LiDAR
scans are moved to the images' time; from 5 on a sample says whether its road is assumed; from 6 on a cache is named by
its bag's content; from 7 on bags may be at URLs. A cache of another version is built again."""

RADAR_VALUES = 6
"""u px, v px, depth m, rcs dBsm, radial speed m/s, age s: what networks are given, NaN where unknown."""

UNKNOWN_CLASS = 255

SAMPLES, INDEX_FILE, CARD = "samples.raw", "index.npy", "drive.json"

INDEX = np.dtype(
    [
        ("offset", "<i8"),
        ("stamp_ns", "<i8"),
        ("height_m", "<f8"),
        ("up", "<f8", 3),
        ("is_assumed", "?"),
        ("returns", "<i4"),
        ("single_pixels", "<i4"),
        ("has_classes", "?"),
        ("has_single", "?"),
    ]
)
"""A line of the index: bytes from the file's beginning, the image's stamp, the road, what the sample has."""


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
        depth_single_m: (H, W) float16 depth of a single scan, NaN unknown; None where `depth_m` serves as that.
    """

    image: ImageArray
    depth_m: npt.NDArray[np.float16]
    classes: npt.NDArray[np.uint8]
    radar: FloatArray
    radar_source: npt.NDArray[np.uint8]
    camera: CameraModel
    ground: GroundPlane
    depth_single_m: npt.NDArray[np.float16] | None = None

    @property
    def depth_single_or_only_m(self) -> npt.NDArray[np.float16]:
        """Depth of a single scan, or the only one: where one ground truth serves as both it stands for that too."""
        return self.depth_m if self.depth_single_m is None else self.depth_single_m


@dataclass(frozen=True)
class DriveCard:
    """What a cached drive was made from and holds.

    Attributes:
        version: Of the layout.
        source: The bag's path or URL.
        source_stamp: Its size and time of change, at a URL its etag: while they are the same where the bag was, nobody
            reads it to know that it is the same.
        source_content: SHA-256 of its content, at a URL its etag: a bag that changed is read again, one that moved is
            not.
        settings: What the samples were made with.
        frames: Number of samples.
        camera: The network's camera: its size is that of the images.
        radars: Names of the radars, in the order of their source index.
        notes: What the bag lacks, a sentence each.
        scans: How its LiDAR scans became ground truth.
    """

    version: int
    source: str
    source_stamp: str
    source_content: str
    settings: Mapping[str, Any]
    frames: int
    camera: CameraModel
    radars: tuple[str, ...]
    notes: tuple[str, ...]
    scans: ScanSummary = field(default_factory=ScanSummary)

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
            values["radars"], values["notes"] = tuple(values["radars"]), tuple(values["notes"])
            values["scans"] = ScanSummary.from_mapping(values["scans"])
            return cls(**values)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise TrainingError(f"{path} does not describe a cached drive ({error}); delete its folder") from None


class SampleWriter:
    """Writes the samples of a drive one after the other.

    Args:
        folder: An empty folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = (folder / SAMPLES).open("wb")
        self._lines: list[tuple[int, int, float, tuple[float, float, float], bool, int, int, bool, bool]] = []

    def __enter__(self) -> SampleWriter:
        return self

    def __exit__(self, *reason: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._lines)

    def write(self, sample: TrainingSample, stamp_ns: int) -> None:
        """Adds a sample; its classes are left out where they are all unknown."""
        has_classes = bool((sample.classes != UNKNOWN_CLASS).any())
        single = np.zeros((0, 0), np.float16) if sample.depth_single_m is None else sample.depth_single_m
        pixels = np.flatnonzero(~np.isnan(single)).astype(np.uint32)
        ground, start = sample.ground, self._file.tell()
        parts: list[npt.NDArray[Any]] = [sample.image, sample.depth_m]
        parts += [sample.classes] if has_classes else []
        parts += [sample.radar, pixels, single.ravel()[pixels], sample.radar_source]
        for part in parts:
            self._file.write(np.ascontiguousarray(part).data)
        has_single = sample.depth_single_m is not None
        road = (ground.height_m, ground.up, ground.is_assumed)
        self._lines.append((start, stamp_ns, *road, len(sample.radar), len(pixels), has_classes, has_single))

    def finish(self, card: DriveCard) -> None:
        """Writes what describes the samples."""
        self._file.flush()
        np.save(self._folder / INDEX_FILE, np.array(self._lines, INDEX))
        card.write(self._folder / CARD)


class CachedDrive:
    """The samples of one bag: opening reads the index alone, a sample is read when it is asked for.

    Args:
        folder: Where it is.

    Raises:
        TrainingError: when it is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.card = DriveCard.read(folder / CARD)
        self._path = folder / SAMPLES
        try:
            self._index = np.load(folder / INDEX_FILE)
            expected = int(self._index["offset"][-1]) + self._size(self._index[-1])
            found = self._path.stat().st_size
            if self._index.dtype != INDEX or len(self._index) != len(self) or found != expected:
                raise ValueError(f"expected {len(self)} samples in {expected} bytes, got {found} bytes")
        except (OSError, ValueError, IndexError) as error:
            raise self._damaged(error) from None

    def __len__(self) -> int:
        return self.card.frames

    @property
    def stamps_ns(self) -> npt.NDArray[np.int64]:
        """(F,) the images' stamps."""
        return np.asarray(self._index["stamp_ns"], np.int64)

    @property
    def folder(self) -> Path:
        """Where it is."""
        return self._path.parent

    @property
    def pixel_bytes(self) -> int:
        """Bytes of all images, depths and classes; of single scans as if each pixel were known."""
        camera = self.card.camera
        each = 8 if self._index["has_single"].any() else 6
        return each * camera.height * camera.width * len(self)

    def __getitem__(self, index: int) -> TrainingSample:
        if not 0 <= index < len(self):
            raise IndexError(index)
        line = self._index[index]
        buffer = np.empty(self._size(line), np.uint8)
        try:
            with self._path.open("rb", buffering=0) as file:
                file.seek(int(line["offset"]))
                read = file.readinto(buffer.data)
            if read != len(buffer):
                raise ValueError(f"sample {index} is cut short")
        except (OSError, ValueError) as error:
            raise self._damaged(error) from None
        row = _Row(buffer)
        camera, returns, pixels = self.card.camera, int(line["returns"]), int(line["single_pixels"])
        shape = (camera.height, camera.width)
        image = row.take(np.uint8, (*shape, 3))
        depth_m = row.take(np.float16, shape)
        unknown = np.broadcast_to(np.uint8(UNKNOWN_CLASS), shape)
        classes = row.take(np.uint8, shape) if line["has_classes"] else unknown
        radar = row.take(np.float32, (returns, RADAR_VALUES))
        places, depths = row.take(np.uint32, (pixels,)), row.take(np.float16, (pixels,))
        single_m = None
        if line["has_single"]:
            single_m = np.full(shape, np.nan, np.float16)
            single_m.ravel()[places] = depths
        up_x, up_y, up_z = (float(value) for value in line["up"])
        return TrainingSample(
            image=image,
            depth_m=depth_m,
            classes=classes,
            radar=radar,
            radar_source=row.take(np.uint8, (returns,)),
            camera=camera,
            ground=GroundPlane(float(line["height_m"]), (up_x, up_y, up_z), bool(line["is_assumed"])),
            depth_single_m=single_m,
        )

    def _size(self, line: np.void) -> int:
        """Bytes of a sample."""
        pixels = self.card.camera.height * self.card.camera.width
        returns, single = int(line["returns"]), int(line["single_pixels"])
        return (6 if line["has_classes"] else 5) * pixels + (4 * RADAR_VALUES + 1) * returns + 6 * single

    def _damaged(self, error: Exception) -> TrainingError:
        return TrainingError(f"the cached drive {self._path.parent} is damaged ({error}); delete it")


class _Row:
    """Arrays one after the other in a buffer."""

    def __init__(self, buffer: npt.NDArray[np.uint8]) -> None:
        self._buffer = buffer
        self._offset = 0

    def take(self, dtype: type[ValueT], shape: tuple[int, ...]) -> npt.NDArray[ValueT]:
        """The next array, as a view."""
        array = np.ndarray(shape, dtype, self._buffer.data, self._offset)
        self._offset += array.nbytes
        return array
