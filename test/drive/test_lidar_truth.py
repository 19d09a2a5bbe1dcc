"""Which LiDAR scans are moved to their image's time, which are taken as they lie, and which are left out."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from lidar_drive import SPEED_MPS, WALL_M

from radcam_depth_ros.drive import DriveError, DriveSettings, Sample, ScanSummary, ScanUse, read_samples
from radcam_depth_ros.training.data.cache import CacheSettings, build_drive, cached_drives
from radcam_depth_ros.training.data.samples import CARD, FORMAT_VERSION, DriveCard

Write = Callable[..., Path]

SHIFT_M = 0.02 * SPEED_MPS
"""What the vehicle drives between an image and its scan."""


def wall_off_m(index: int, sample: Sample) -> float:
    """How much too near the wall is."""
    walls_m = sample.depth_m[sample.depth_m > 40]
    assert len(walls_m)
    return WALL_M - SPEED_MPS * index / 10 - 1.0 - float(np.median(walls_m))


@pytest.mark.parametrize("accumulate", ["never", "where_possible", "always"])
@pytest.mark.parametrize("motion", [{}, {"odometry": False, "tf": True}])
def test_scans_are_moved_by_odometry_or_tf(write_drive_with: Write, accumulate: str, motion: dict[str, bool]) -> None:
    samples = list(read_samples(write_drive_with(**motion), DriveSettings(accumulate=accumulate)))
    assert len(samples) == 12
    for index, sample in enumerate(samples):
        assert wall_off_m(index, sample) == pytest.approx(0, abs=0.02)
        assert sample.scan is not None
        assert sample.scan.use == "moved"
        assert sample.scan.offset_s == pytest.approx(0.02)
        assert sample.scan.shift_m == pytest.approx(SHIFT_M, abs=1e-6)


@pytest.mark.parametrize("doppler", [False, True])
def test_without_motion_scans_are_taken_as_they_lie(write_drive_with: Write, doppler: bool) -> None:
    for index, sample in enumerate(read_samples(write_drive_with(odometry=False, doppler=doppler))):
        assert wall_off_m(index, sample) == pytest.approx(SHIFT_M, abs=0.02)
        assert sample.scan is not None
        assert sample.scan.use == "as_it_lies"
        assert sample.scan.offset_s == pytest.approx(0.02)
        # The radar's Doppler tells how much that matters.
        assert sample.scan.shift_m == pytest.approx(SHIFT_M if doppler else math.nan, rel=0.05, nan_ok=True)


@pytest.mark.parametrize("accumulate", ["never", "where_possible", "always"])
@pytest.mark.parametrize("motion", [{}, {"odometry": False, "tf": True}])
def test_scans_that_cannot_be_moved_are_left_out(
    write_drive_with: Write, accumulate: str, motion: dict[str, bool]
) -> None:
    drive = write_drive_with(motion_from_s=0.31, motion_until_s=0.73, **motion)
    samples = list(read_samples(drive, DriveSettings(accumulate=accumulate)))
    used = [sample.scan.use for sample in samples if sample.scan is not None]
    assert used == ["left_out"] * 4 + ["moved"] * 4 + ["left_out"] * 4
    for index, sample in enumerate(samples):
        assert sample.scan is not None
        if sample.scan.use == "moved":
            assert wall_off_m(index, sample) == pytest.approx(0, abs=0.02)
        else:
            assert sample.source == "none"
            assert np.isnan(sample.depth_m).all()
            assert sample.depth_single_m is None
            assert "'base'" in sample.scan.reason


def test_a_drive_of_which_hardly_any_scan_can_be_moved_says_why(write_drive_with: Write) -> None:
    told: list[str] = []
    list(read_samples(write_drive_with(frames=40, motion_until_s=0.33), DriveSettings(), told.append))
    assert len(told) == 1
    assert "36 scans on /lidar/points cannot be moved" in told[0]
    assert "record the vehicle's motion all the time" in told[0]


def test_odometry_of_a_frame_that_nobody_knows(write_drive_with: Write) -> None:
    with pytest.raises(DriveError, match=r"'camera' is fixed to, got child_frame_id 'gps' on /odom; record /tf_static"):
        list(read_samples(write_drive_with(odometry_frame="gps")))
    for sample in read_samples(write_drive_with(odometry_frame="gps", tf=True)):
        assert sample.scan is not None
        assert sample.scan.use == "moved"


def test_a_summary_of_scans() -> None:
    uses = [
        ScanUse("moved", 0.02, 0.3),
        ScanUse("moved", -0.04),
        ScanUse("as_it_lies", -0.03),
        ScanUse("left_out", 0.01, reason="no odometry came"),
    ]
    summary = ScanSummary.of(uses)
    assert summary.scans == 4
    moved, still, left_out = summary.sentences
    assert moved.startswith("2 moved")
    assert "30 ms" in moved
    assert "40 at most" in moved
    assert "0.30 m" in moved
    assert still.startswith("1 taken as they lie")
    assert "0.30 m at 10 m/s" in still
    assert "not known" in still
    assert left_out == "1 left out, since they could not be moved: no odometry came"
    assert ScanSummary().sentences == ()
    parts = ScanSummary.joined(ScanSummary.of([use]) for use in uses)
    assert parts.sentences == summary.sentences
    again = ScanSummary.from_mapping(json.loads(json.dumps(dataclasses.asdict(summary))))
    assert again.as_json() == summary.as_json()
    assert json.loads(json.dumps(summary.as_json()))["as_they_lie"]["mean_shift_m"] is None


def test_a_cache_tells_scans_that_were_not_moved(tmp_path: Path, write_drive_with: Write) -> None:
    told: list[str] = []
    bag = write_drive_with(odometry=False)
    cached_drives([bag], tmp_path / "cache", CacheSettings(100.0, 100.0), on_note=told.append)
    lack, scans = told
    assert "it does not say how the vehicle moved" in lack
    assert scans.startswith(f"{bag}: LiDAR scans: 12 taken as they lie")
    assert "20 ms from their images" in scans


def test_a_cache_of_moved_scans_has_nothing_to_tell(tmp_path: Path, write_drive_with: Write) -> None:
    told: list[str] = []
    (drive,) = cached_drives([write_drive_with()], tmp_path / "cache", CacheSettings(100.0, 100.0), on_note=told.append)
    assert not told
    assert drive.card.scans.moved.scans == 12


def test_a_cache_from_before_scans_were_moved_is_built_again(tmp_path: Path, write_drive_with: Write) -> None:
    bag, place, settings = write_drive_with(), tmp_path / "cache" / "drive", CacheSettings(100.0, 100.0)
    build_drive(bag, place, settings)
    card = json.loads((place / CARD).read_text())
    (place / CARD).write_text(json.dumps({**card, "version": 3}))
    build_drive(bag, place, settings)
    assert DriveCard.read(place / CARD).version == FORMAT_VERSION == 7
