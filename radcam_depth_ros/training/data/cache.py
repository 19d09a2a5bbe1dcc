"""Builds cached drives from bags: decode, pair, accumulate and resample once, then train from raw arrays."""

from __future__ import annotations

import fcntl
import glob
import hashlib
import json
import multiprocessing
import os
import shutil
import stat
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from radcam_depth_ros import configuration
from radcam_depth_ros.drive import DriveSettings, Sample, ScanSummary, ScanUse, read_samples
from radcam_depth_ros.estimator import radar_columns
from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.resampling import resample_image
from radcam_depth_ros.storage import content_at, place_of, staged, stamp_at
from radcam_depth_ros.training.data.samples import (
    CARD,
    FORMAT_VERSION,
    RADAR_VALUES,
    UNKNOWN_CLASS,
    CachedDrive,
    DriveCard,
    SampleWriter,
    TrainingSample,
)
from radcam_depth_ros.training.data.shared_cache import SharedCache
from radcam_depth_ros.training.errors import TrainingError


@dataclass(frozen=True)
class CacheSettings:
    """What cached samples are made with; other settings make another cache.

    Attributes:
        focal_length_px: The network's.
        max_depth_m: Farthest depth that the network gives: returns beyond it are left out.
        drive: How bags are read: LiDAR scans are accumulated where the bag tells how the vehicle moved.
    """

    focal_length_px: float
    max_depth_m: float
    drive: DriveSettings = field(default_factory=lambda: DriveSettings(accumulate="where_possible"))


def cached_drives(
    bags: Sequence[Path],
    folder: Path,
    settings: CacheSettings,
    processes: int = 1,
    on_bag: Callable[[Path], None] = lambda bag: None,
    on_note: Callable[[str], None] = lambda note: None,
    shared: SharedCache | None = None,
) -> tuple[CachedDrive, ...]:
    """The cached drives of some bags; those that are missing, or whose bag or settings changed, are built.

    Args:
        bags: Bag folders or files, on a disk or at URLs.
        folder: Where caches are kept.
        settings: What samples are made with.
        processes: Bags that are read at once.
        on_bag: Called after each bag that is ready.
        on_note: Told what the bags lack, once for all that lack the same.
        shared: Looked into before a bag is read, and given what is built.

    Raises:
        TrainingError: for a bag without any frame with ground truth, or when the cache cannot be written.
        BagError: for a bag that cannot be read.
        StorageError: for storage that cannot be read or written.
    """
    places = {bag: _located(bag, folder, settings) or folder / cache_name(bag, settings) for bag in bags}
    missing = [bag for bag in bags if not _is_current(bag, places[bag], settings)]
    for bag in bags:
        if bag not in missing:
            on_bag(bag)
    if len(missing) > 1 and processes > 1:
        # spawn: a forked child of a process that has used torch's threads may hang.
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            futures = {pool.submit(build_drive, bag, places[bag], settings, shared): bag for bag in missing}
            try:
                for future in as_completed(futures):
                    future.result()
                    on_bag(futures[future])
            except BrokenProcessPool:
                raise TrainingError(
                    "a process that prepared samples was killed, most likely since memory ran out; prepare fewer bags "
                    "at once (--processes 1), what is ready is kept"
                ) from None
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    else:
        for bag in missing:
            build_drive(bag, places[bag], settings, shared)
            on_bag(bag)
    drives = tuple(CachedDrive(places[bag]) for bag in bags)
    _tell_notes(drives, on_note)
    return drives


def _tell_notes(drives: Sequence[CachedDrive], on_note: Callable[[str], None]) -> None:
    sources: dict[str, list[str]] = {}
    for drive in drives:
        for note in drive.card.notes:
            sources.setdefault(note, []).append(drive.card.source)
    for note, bags in sources.items():
        on_note(f"{_some(bags)}: {note}")
    # Where all were moved there is nothing to know.
    unmoved = [drive.card for drive in drives if drive.card.scans.as_they_lie.scans or drive.card.scans.left_out.scans]
    if unmoved:
        scans = ScanSummary.joined(card.scans for card in unmoved)
        on_note(f"{_some([card.source for card in unmoved])}: LiDAR scans: {'; '.join(scans.sentences)}")


def _some(bags: Sequence[str]) -> str:
    others = f" and {len(bags) - 1} more bags" if len(bags) > 1 else ""
    return f"{bags[0]}{others}"


def build_drive(
    bag: Path, place: Path, settings: CacheSettings, shared: SharedCache | None = None, local: Path | None = None
) -> None:
    """Takes a cached drive from the shared cache, or reads its bag; `place` appears whole or not at all.

    Processes that build the same drive at once take turns, and the later ones find it built. What a killed one left
    behind is removed.

    Args:
        bag: The bag, on a disk or at a URL.
        place: Where its cached drive is to be.
        settings: What samples are made with.
        shared: Looked into first, and given what is built.
        local: The bag on this disk, where somebody has fetched it already.

    Raises:
        TrainingError: when no frame of the bag has ground truth, the camera changes within it, or the disk is full.
        StorageError: for storage that cannot be read or written.
    """
    partial = place.with_name(place.name + ".part")
    try:
        with _locked(partial):
            if _is_current(bag, place, settings):
                partial.rmdir()
                return
            try:
                if shared is None or not shared.fetch(place.name, partial):
                    _write_drive(bag, partial, settings, local)
                    if shared is not None:
                        shared.put(partial, place.name)
                shutil.rmtree(place, ignore_errors=True)
                partial.rename(place)
            except BaseException:
                shutil.rmtree(partial, ignore_errors=True)
                raise
    except OSError as error:
        raise TrainingError(
            f"cannot write the sample cache {place.parent}: {error.strerror or error}; free some space there or choose "
            "another place with --cache"
        ) from None


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Makes an empty folder that this process alone writes to; waits for another one that does.

    The lock is on the folder itself: it goes with the process, and no file is left.
    """
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # another process has just finished it
        except FileExistsError:  # what mkdir says, too, when another process removes it while this one looks
            # One look, since it may be removed between two.
            with suppress(FileNotFoundError):
                if not stat.S_ISDIR(folder.lstat().st_mode):
                    raise
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            # Another process may have finished while this one waited, and its folder has another name now.
            if _inode(folder) == os.fstat(handle).st_ino:
                for leftover in folder.iterdir():
                    leftover.unlink()
                yield
                return
        finally:
            os.close(handle)


def _inode(folder: Path) -> int | None:
    # One call: between asking whether it is there and what it is, another process may remove it.
    try:
        return folder.stat().st_ino
    except FileNotFoundError:
        return None


def _write_drive(bag: Path, folder: Path, settings: CacheSettings, local: Path | None) -> None:
    source = place_of(bag)
    origin = (source, _stamp(bag), content_at(source))
    camera: CameraModel | None = None
    radars: tuple[str, ...] = ()
    notes: list[str] = []
    scans: list[ScanUse] = []
    with nullcontext(local) if local else staged(source) as bag_here, SampleWriter(folder) as writer:
        for sample in read_samples(bag_here, settings.drive, notes.append):
            if sample.scan is not None:
                scans.append(sample.scan)
            if sample.source == "none":
                continue
            plan = CanonicalCamera.plan(sample.frame.camera, settings.focal_length_px)
            camera = camera or plan.network
            if plan.network != camera:
                raise TrainingError(
                    f"{bag}: the camera changes within the bag, from {camera} to {plan.network}; record a bag for each"
                )
            writer.write(_at_focal_length(sample, plan, settings), sample.frame.stamp_ns)
            radars = sample.radars
        summary = ScanSummary.of(scans)
        if camera is None:
            raise TrainingError(
                f"{bag} has no frame with ground truth; training needs a depth image topic, or a LiDAR topic with "
                "stamps near the images'" + "".join(f"; of the scans {found}" for found in summary.sentences)
            )
        mapping = configuration.as_mapping(settings)
        card = DriveCard(FORMAT_VERSION, *origin, mapping, len(writer), camera, radars, tuple(notes), summary)
        writer.finish(card)


def _at_focal_length(sample: Sample, plan: CanonicalCamera, settings: CacheSettings) -> TrainingSample:
    classes = np.full((plan.network.height, plan.network.width), UNKNOWN_CLASS, np.uint8)
    if sample.classes is not None:
        rows, columns = _nearest_source(plan)
        classes[: plan.scaled.height, : plan.scaled.width] = sample.classes[rows[:, None], columns[None, :]]
    depth_m = resample_depth(sample.depth_m, plan, sparse=sample.source == "lidar")
    single_m = None
    if sample.depth_single_m is not None:
        single_m = resample_depth(sample.depth_single_m, plan, sparse=True).astype(np.float16)
    radar, source = _returns(sample, plan, settings)
    return TrainingSample(
        image=resample_image(sample.frame.image, plan, sample.frame.lens),
        depth_m=depth_m.astype(np.float16),
        classes=classes,
        radar=radar,
        radar_source=source,
        camera=plan.network,
        ground=sample.frame.ground,
        depth_single_m=single_m,
    )


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
        return np.zeros((0, RADAR_VALUES), np.float32), np.zeros(0, np.uint8)
    return np.concatenate(columns), np.concatenate(sources)


def cache_name(bag: Path, settings: CacheSettings) -> str:
    """The name of a bag's cached drive: by content, so that a cache serves wherever its bag and itself are."""
    _stamp(bag)
    mapping = configuration.as_mapping(settings)
    key = json.dumps([FORMAT_VERSION, content_at(place_of(bag)), mapping], sort_keys=True)
    return f"{bag.stem}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"


def _is_current(bag: Path, place: Path, settings: CacheSettings) -> bool:
    if not (place / CARD).is_file():
        return False
    try:
        card = DriveCard.read(place / CARD)
    except TrainingError:
        return False
    if card.version != FORMAT_VERSION or card.settings != configuration.as_mapping(settings):
        return False
    return _is_where_it_was(bag, card) or card.source_content == content_at(place_of(bag))


def _is_where_it_was(bag: Path, card: DriveCard) -> bool:
    return (card.source, card.source_stamp) == (place_of(bag), _stamp(bag))


def _located(bag: Path, folder: Path, settings: CacheSettings) -> Path | None:
    """The cache of a bag that has not changed since, found without reading the bag; None where there is none."""
    _stamp(bag)  # a bag that is gone is told, whatever is cached
    mapping = configuration.as_mapping(settings)
    for place in sorted(folder.glob(f"{glob.escape(bag.stem)}-*")):
        with suppress(TrainingError):
            card = DriveCard.read(place / CARD)
            if card.version == FORMAT_VERSION and card.settings == mapping and _is_where_it_was(bag, card):
                return place
    return None


def _stamp(bag: Path) -> str:
    """What tells without reading whether a bag changed; TrainingError where it is gone."""
    stamp = stamp_at(place_of(bag))
    if not stamp:
        raise TrainingError(f"there is no bag at {place_of(bag)} any more; put it back, or start a run without it")
    return stamp
