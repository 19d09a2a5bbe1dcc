from __future__ import annotations

import dataclasses
import errno
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from radcam_depth_ros.drive import DriveSettings, Sample
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.training.data import cache
from radcam_depth_ros.training.data.batches import collate
from radcam_depth_ros.training.data.cache import CacheSettings, build_drive, cached_drives, resample_depth
from radcam_depth_ros.training.data.samples import CachedDrive, SampleWriter
from radcam_depth_ros.training.data.views import crop, mirrored
from radcam_depth_ros.training.errors import TrainingError

SETTINGS = CacheSettings(630.0, 100.0)
Frames = Callable[[int, int], Iterator[Sample]]


def test_a_cached_drive_gives_back_what_the_bag_holds(drive: CachedDrive, frames: Frames) -> None:
    assert len(drive) == 6
    assert drive.card.radars == ("/radar/points", "/radar_4d/points")
    for cached, original in zip((drive[index] for index in range(6)), frames(0, 6), strict=True):
        np.testing.assert_array_equal(cached.image, original.frame.image)
        np.testing.assert_allclose(cached.depth_m, original.depth_m, rtol=1e-3)
        np.testing.assert_array_equal(cached.classes, original.classes)
        np.testing.assert_array_equal(cached.radar_source, [0, 1, 1])
        np.testing.assert_allclose(cached.radar[:, 2], original.frame.radar.xyz_m[:, 2])
        assert cached.camera == original.frame.camera
        assert cached.ground == original.frame.ground


def test_a_drive_ends(drive: CachedDrive) -> None:
    with pytest.raises(IndexError):
        drive[6]


def test_a_cache_is_read_again_only_when_bag_or_settings_change(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], read_bags: list[Path]
) -> None:
    bags = make_bags(2)
    cached_drives(bags, tmp_path / "cache", SETTINGS)
    assert read_bags == bags
    cached_drives(bags, tmp_path / "cache", SETTINGS)
    assert read_bags == bags
    bags[1].write_bytes(b"recorded again")
    os.utime(bags[1], ns=(1, 1))
    cached_drives(bags, tmp_path / "cache", SETTINGS)
    assert read_bags == [*bags, bags[1]]
    drives = cached_drives(bags, tmp_path / "cache", CacheSettings(315.0, 100.0))
    assert read_bags == [*bags, bags[1], *bags]
    assert drives[0].card.camera.width == 64
    cached_drives(bags, tmp_path / "cache", CacheSettings(630.0, 100.0, DriveSettings(max_lidar_offset_s=0.01)))
    assert read_bags == [*bags, bags[1], *bags, *bags]


def test_a_cache_serves_wherever_its_bag_and_itself_are(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], read_bags: list[Path]
) -> None:
    bags = make_bags(2)
    cached_drives(bags, tmp_path / "cache", SETTINGS)
    (tmp_path / "elsewhere").mkdir()
    moved = [bag.rename(tmp_path / "elsewhere" / bag.name) for bag in bags]
    os.utime(moved[0], ns=(1, 1))
    (tmp_path / "cache").rename(tmp_path / "copied")
    drives = cached_drives(moved, tmp_path / "copied", SETTINGS)
    assert read_bags == bags
    assert [len(drive) for drive in drives] == [6, 6]
    # The same size at the same time, and yet another bag.
    before = moved[1].stat()
    moved[1].write_bytes(b"made UP")
    os.utime(moved[1], ns=(before.st_mtime_ns + 1, before.st_mtime_ns + 1))
    cached_drives(moved, tmp_path / "copied", SETTINGS)
    assert read_bags == [*bags, moved[1]]


def test_a_bag_that_fails_leaves_nothing_behind(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(path: Path, settings: DriveSettings, warn: Callable[[str], None]) -> Iterator[Sample]:
        yield from frames(0, 2)
        raise TrainingError("the bag ends here")

    monkeypatch.setattr(cache, "read_samples", fails)
    with pytest.raises(TrainingError, match="ends here"):
        cached_drives(make_bags(1), tmp_path / "cache", SETTINGS)
    assert not list((tmp_path / "cache").iterdir())


@pytest.mark.parametrize("count", [0, 2])
def test_a_bag_without_ground_truth_is_refused(
    count: int,
    tmp_path: Path,
    make_bags: Callable[[int], list[Path]],
    frames: Frames,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blind = [dataclasses.replace(sample, source="none") for sample in frames(0, count)]
    monkeypatch.setattr(cache, "read_samples", lambda path, settings, warn: iter(blind))
    with pytest.raises(TrainingError, match=r"no frame with ground truth.*LiDAR"):
        build_drive(make_bags(1)[0], tmp_path / "drive", SETTINGS)


def test_a_camera_that_changes_is_refused(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = frames(0, 2)
    other = dataclasses.replace(second.frame, camera=dataclasses.replace(second.frame.camera, cx=50.0))
    samples = [first, dataclasses.replace(second, frame=other)]
    monkeypatch.setattr(cache, "read_samples", lambda path, settings, warn: iter(samples))
    with pytest.raises(TrainingError, match="camera changes"):
        build_drive(make_bags(1)[0], tmp_path / "drive", SETTINGS)


def test_a_damaged_cache_is_told(tmp_path: Path, drive: CachedDrive) -> None:
    (tmp_path / "drive" / "samples.raw").write_bytes(b"short")
    with pytest.raises(TrainingError, match="damaged"):
        CachedDrive(tmp_path / "drive")


@pytest.mark.parametrize("sparse", [False, True])
def test_resampling_never_blends_depths(sparse: bool) -> None:
    depth = np.full((60, 100), 5.0, np.float32)
    depth[:, 50:] = 80.0
    plan = CanonicalCamera.plan(CameraModel(100, 60, 900.0, 900.0, 50.0, 30.0), 630.0)
    result = resample_depth(depth, plan, sparse=sparse)
    assert result.shape == (64, 96)
    assert set(np.unique(result[: plan.scaled.height, : plan.scaled.width])) == {5.0, 80.0}
    assert np.isnan(result[plan.scaled.height :]).all()
    assert np.isnan(result[:, plan.scaled.width :]).all()


def test_no_sparse_point_is_lost_and_the_nearest_wins() -> None:
    depth = np.full((60, 100), np.nan, np.float32)
    depth[10, 10], depth[10, 11], depth[33, 77] = 30.0, 20.0, 40.0
    plan = CanonicalCamera.plan(CameraModel(100, 60, 1260.0, 1260.0, 50.0, 30.0), 630.0)
    result = resample_depth(depth, plan, sparse=True)
    assert np.nanmin(result) == 20.0
    assert np.isfinite(result).sum() == 2
    assert result[5, 5] == 20.0
    assert result[16, 38] == 40.0


def test_the_single_scans_depth_is_kept_where_it_differs(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    single = np.full((64, 128), np.nan, np.float32)
    single[30, 5:9] = 7.5
    with_single = [dataclasses.replace(sample, depth_single_m=single) for sample in frames(0, 1)]
    monkeypatch.setattr(cache, "read_samples", lambda path, settings, warn: iter([*with_single, *frames(1, 1)]))
    build_drive(make_bags(1)[0], tmp_path / "drive", SETTINGS)
    drive = CachedDrive(tmp_path / "drive")
    np.testing.assert_array_equal(drive[0].depth_single_m, single)
    assert drive[1].depth_single_m is None
    batch = collate([drive[0], drive[1]])
    assert batch.depth_single_m is not None
    np.testing.assert_array_equal(batch.depth_single_m[0, 0], single)
    # One ground truth serves as both.
    np.testing.assert_array_equal(batch.depth_single_m[1], batch.depth_accumulated_m[1])
    cut = mirrored(crop(drive[0], 20, 4, 32, 64))
    assert cut.depth_single_m is not None
    assert np.flatnonzero(np.isfinite(cut.depth_single_m[10])).tolist() == [59, 60, 61, 62]


def test_those_who_build_the_same_drive_at_once_take_turns(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], read_bags: list[Path]
) -> None:
    bag, place = make_bags(1)[0], tmp_path / "cache" / "drive"
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: build_drive(bag, place, SETTINGS), range(4)))
        for _ in range(20):  # who finds it built removes an empty folder that another may be about to lock
            list(pool.map(lambda _: build_drive(bag, place, SETTINGS), range(4)))
    assert read_bags == [bag]
    assert list(place.parent.iterdir()) == [place]


def test_what_a_killed_process_left_is_replaced(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], read_bags: list[Path]
) -> None:
    place = tmp_path / "cache" / "drive"
    left = place.with_name("drive.part")
    left.mkdir(parents=True)
    (left / "samples.raw").write_bytes(b"half of it")
    (left / "other.raw").write_bytes(b"of an older version")
    build_drive(make_bags(1)[0], place, SETTINGS)
    assert len(CachedDrive(place)) == 6
    assert sorted(file.name for file in place.iterdir()) == ["drive.json", "index.npy", "samples.raw"]
    assert not left.exists()


def test_a_full_disk_is_told_and_leaves_nothing(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def is_full(writer: SampleWriter, sample: object, stamp_ns: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(SampleWriter, "write", is_full)
    with pytest.raises(
        TrainingError, match=r"cannot write the sample cache .*No space left on device; free some space"
    ):
        cached_drives(make_bags(2), tmp_path / "cache", SETTINGS)
    assert not list((tmp_path / "cache").iterdir())


def test_what_many_bags_lack_is_told_once(
    tmp_path: Path, make_bags: Callable[[int], list[Path]], frames: Frames, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lacks(path: Path, settings: DriveSettings, warn: Callable[[str], None]) -> Iterator[Sample]:
        warn("no odometry")
        return frames(0, 1)

    monkeypatch.setattr(cache, "read_samples", lacks)
    bags, told = make_bags(3), []
    for _ in range(2):  # the second time from the cache
        cached_drives(bags, tmp_path / "cache", SETTINGS, on_note=told.append)
    assert told == [f"{bags[0]} and 2 more bags: no odometry"] * 2


def test_a_bag_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"no bag at .*gone\.mcap any more"):
        build_drive(tmp_path / "gone.mcap", tmp_path / "drive", SETTINGS)


def test_a_drive_keeps_no_file_open_and_tells_when_it_was_cut_short(tmp_path: Path, drive: CachedDrive) -> None:
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir()))
    many = [CachedDrive(tmp_path / "drive") for _ in range(50)]
    samples = [opened[3] for opened in many]
    assert len(list(descriptors.iterdir())) == before
    # Each has memory of its own, and goes with it.
    assert not np.shares_memory(samples[0].image, samples[1].image)
    os.truncate(tmp_path / "drive" / "samples.raw", 100)
    with pytest.raises(TrainingError, match="damaged"):
        drive[5]
