"""Builds cached drives from bags: decode, pair and resample once, then train from memory maps."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from radcam_depth_ros import configuration
from radcam_depth_ros.drive import DriveSettings, Sample, read_samples
from radcam_depth_ros.estimator import radar_columns
from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.resampling import resample_image
from radcam_depth_ros.training.samples import (
    FORMAT_VERSION,
    RADAR_COLUMNS,
    UNKNOWN_CLASS,
    CachedDrive,
    DriveCard,
    TrainingError,
)


@dataclass(frozen=True)
class CacheSettings:
    """What cached samples are made with; other settings make another cache.

    Attributes:
        focal_length_px: The network's.
        max_depth_m: Farthest depth that the network gives: returns beyond it are left out.
        drive: How bags are read.
    """

    focal_length_px: float
    max_depth_m: float
    drive: DriveSettings = field(default_factory=DriveSettings)


def cached_drives(
    bags: Sequence[Path],
    folder: Path,
    settings: CacheSettings,
    processes: int = 1,
    on_bag: Callable[[Path], None] = lambda bag: None,
) -> tuple[CachedDrive, ...]:
    """The cached drives of some bags; those that are missing, or whose bag or settings changed, are built.

    Args:
        bags: Bag folders or files.
        folder: Where caches are kept.
        settings: What samples are made with.
        processes: Bags that are read at once.
        on_bag: Called after each bag that is ready.

    Raises:
        TrainingError: for a bag without any frame with ground truth, or when the cache cannot be written.
        BagError: for a bag that cannot be read.
    """
    places = {bag: _place(bag, folder, settings) for bag in bags}
    missing = [bag for bag in bags if not _is_current(bag, places[bag], settings)]
    for bag in bags:
        if bag not in missing:
            on_bag(bag)
    if len(missing) > 1 and processes > 1:
        # spawn: a forked child of a process that has used torch's threads may hang.
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            futures = {pool.submit(build_drive, bag, places[bag], settings): bag for bag in missing}
            try:
                for future in as_completed(futures):
                    future.result()
                    on_bag(futures[future])
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    else:
        for bag in missing:
            build_drive(bag, places[bag], settings)
            on_bag(bag)
    return tuple(CachedDrive(places[bag]) for bag in bags)


def build_drive(bag: Path, place: Path, settings: CacheSettings) -> None:
    """Reads a bag and writes its cached drive; `place` appears whole or not at all.

    Raises:
        TrainingError: when no frame of the bag has ground truth, the image size changes within it, or the disk is full.
    """
    partial = place.with_name(place.name + ".part")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir(parents=True)
        _write_drive(bag, partial, settings)
        shutil.rmtree(place, ignore_errors=True)
        partial.rename(place)
    except OSError as error:
        raise TrainingError(
            f"cannot write the sample cache {place.parent}: {error.strerror or error}; free some space there or choose "
            "another place with --cache"
        ) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write_drive(bag: Path, folder: Path, settings: CacheSettings) -> None:
    camera: CameraModel | None = None
    radar: list[FloatArray] = []
    source: list[npt.NDArray[np.uint8]] = []
    ground: list[list[float]] = []
    stamps: list[int] = []
    radars: tuple[str, ...] = ()
    classes_seen = 0
    with ExitStack() as files:
        image_file, depth_file, classes_file = (
            files.enter_context((folder / f"{kind}.raw").open("wb")) for kind in ("image", "depth", "classes")
        )
        for sample in read_samples(bag, settings.drive):
            if sample.source == "none":
                continue
            plan = CanonicalCamera.plan(sample.frame.camera, settings.focal_length_px)
            camera = camera or plan.network
            if plan.network != camera:
                raise TrainingError(
                    f"{bag}: the camera changes within the bag, from {camera} to {plan.network}; record a bag for each"
                )
            _write_images(sample, plan, image_file, depth_file, classes_file)
            classes_seen += sample.classes is not None
            returns, kept_source = _returns(sample, plan, settings)
            radar.append(returns)
            source.append(kept_source)
            ground.append([sample.frame.ground.height_m, *sample.frame.ground.up])
            stamps.append(sample.frame.stamp_ns)
            radars = sample.radars
    if camera is None:
        raise TrainingError(
            f"{bag} has no frame with ground truth; training needs a depth image topic, or a LiDAR topic with "
            "stamps near the images'"
        )
    np.save(folder / "radar.npy", np.concatenate(radar).reshape(-1, RADAR_COLUMNS))
    np.save(folder / "radar_source.npy", np.concatenate(source))
    np.save(folder / "radar_start.npy", np.cumsum([0, *(len(part) for part in radar)], dtype=np.int64))
    np.save(folder / "ground.npy", np.array(ground, np.float64))
    np.save(folder / "stamp_ns.npy", np.array(stamps, np.int64))
    if not classes_seen:
        (folder / "classes.raw").unlink()
    size, mtime_ns = _bag_stat(bag)
    mapping = configuration.as_mapping(settings)
    card = DriveCard(FORMAT_VERSION, str(bag), size, mtime_ns, mapping, len(radar), camera, radars, classes_seen > 0)
    card.write(folder / "drive.json")


def _write_images(
    sample: Sample, plan: CanonicalCamera, image_file: BinaryIO, depth_file: BinaryIO, classes_file: BinaryIO
) -> None:
    image_file.write(resample_image(sample.frame.image, plan, sample.frame.lens).data)
    depth = resample_depth(sample.depth_m, plan, sparse=sample.source == "lidar")
    depth_file.write(depth.astype(np.float16).data)
    size = (plan.network.height, plan.network.width)
    classes = np.full(size, UNKNOWN_CLASS, np.uint8)
    if sample.classes is not None:
        rows, columns = _nearest_source(plan)
        classes[: plan.scaled.height, : plan.scaled.width] = sample.classes[rows[:, None], columns[None, :]]
    classes_file.write(classes.data)


def resample_depth(depth_m: FloatArray, plan: CanonicalCamera, *, sparse: bool) -> FloatArray:
    """Brings ground truth to the network's focal length without ever blending depths across edges.

    Args:
        depth_m: (H, W) metres, NaN unknown, +inf sky, at the size of `plan.source`.
        plan: The plan.
        sparse: Few pixels are known (LiDAR): each goes to its place and the nearest wins, so that none is lost. Else
            each pixel takes the value of the one that is nearest to it.

    Returns:
        (H', W') float32 at the size of `plan.network`, NaN in the padding.
    """
    result = np.full((plan.network.height, plan.network.width), np.nan, np.float32)
    if sparse:
        source_row, source_column = np.nonzero(~np.isnan(depth_m))
        depth = depth_m[source_row, source_column]
        row = (source_row + 0.5) * plan.scaled.height // plan.source.height
        column = (source_column + 0.5) * plan.scaled.width // plan.source.width
        nearest = np.full(result.shape, np.inf, np.float32)
        hit = np.zeros(result.shape, np.bool_)
        place = (row.astype(np.int64), column.astype(np.int64))
        np.minimum.at(nearest, place, depth)
        hit[place] = True
        result[hit] = nearest[hit]
    else:
        rows, columns = _nearest_source(plan)
        result[: plan.scaled.height, : plan.scaled.width] = depth_m[rows[:, None], columns[None, :]]
    return result


def _nearest_source(plan: CanonicalCamera) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The source's row of each scaled row, and column of each scaled column."""
    rows = (np.arange(plan.scaled.height) + 0.5) * plan.source.height / plan.scaled.height
    columns = (np.arange(plan.scaled.width) + 0.5) * plan.source.width / plan.scaled.width
    return rows.astype(np.int64), columns.astype(np.int64)


def _returns(
    sample: Sample, plan: CanonicalCamera, settings: CacheSettings
) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """The returns that a network would be given, radar by radar, and the radar of each."""
    columns, sources = [], []
    for index, part in enumerate(sample.radar_parts):
        columns.append(radar_columns(part, plan.network, settings.max_depth_m))
        sources.append(np.full(len(columns[-1]), index, np.uint8))
    if not columns:
        return np.zeros((0, RADAR_COLUMNS), np.float32), np.zeros(0, np.uint8)
    return np.concatenate(columns), np.concatenate(sources)


def _place(bag: Path, folder: Path, settings: CacheSettings) -> Path:
    mapping = configuration.as_mapping(settings)
    key = json.dumps([FORMAT_VERSION, str(bag.resolve()), mapping], sort_keys=True)
    return folder / f"{bag.stem}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"


def _is_current(bag: Path, place: Path, settings: CacheSettings) -> bool:
    if not (place / "drive.json").is_file():
        return False
    card = DriveCard.read(place / "drive.json")
    size, mtime_ns = _bag_stat(bag)
    same_bag = (card.source_size, card.source_mtime_ns) == (size, mtime_ns)
    return same_bag and card.version == FORMAT_VERSION and card.settings == configuration.as_mapping(settings)


def _bag_stat(bag: Path) -> tuple[int, int]:
    """Size and time of change of a bag, whether a file or a folder of files."""
    parts = [part.stat() for part in (sorted(bag.iterdir()) if bag.is_dir() else [bag])]
    return sum(part.st_size for part in parts), max((part.st_mtime_ns for part in parts), default=0)
