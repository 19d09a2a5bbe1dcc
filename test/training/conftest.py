from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from radcam_depth_ros.drive import DriveSettings, Sample
from radcam_depth_ros.frame import CameraModel, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.reporting import page
from radcam_depth_ros.training.data import cache
from radcam_depth_ros.training.data.cache import CacheSettings, build_drive
from radcam_depth_ros.training.data.samples import CachedDrive

DRAWING = {"test_a_page_holds_all_that_it_shows", "test_a_network_is_trained_and_trained_on"}
"""Tests in which the plots of a training's page are drawn; that takes most of the time of a short training."""

CAMERA = CameraModel(128, 64, 630.0, 630.0, 63.5, 20.0)


def make_frames(seed: int, count: int) -> Iterator[Sample]:
    """A grey road below a white sky, with a wall of its own colour at a random depth."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        depth = np.full((64, 128), np.inf, np.float32)
        depth[24:] = (630 * 0.5 / (np.arange(24, 64) - 20.0))[:, None]
        wall, left = float(rng.uniform(5, 40)), int(rng.integers(8, 80))
        depth[10:50, left : left + 40] = wall
        depth[0, 0] = np.nan
        image = np.where(np.isinf(depth), 230, 90).astype(np.uint8)
        image[10:50, left : left + 40] = round(250 - 4 * wall)
        xyz = np.array([[(left + 20 - 63.5) / 630 * wall, 0.2, wall]] * 3, np.float32)
        frame = Frame(
            stamp_ns=index * 100_000_000,
            frame_id="camera",
            image=np.repeat(image[..., None], 3, axis=2),
            camera=CAMERA,
            radar=RadarReturns.from_points(xyz),
            ground=GroundPlane(0.5),
            radar_counts=(1, 2),
        )
        classes = np.zeros((64, 128), np.uint8)
        yield Sample(frame, ("/radar/points", "/radar_4d/points"), depth, "exact", classes)


@pytest.fixture(autouse=True)
def _plots_are_left_empty(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for `DRAWING`."""
    if request.function.__name__ not in DRAWING:
        monkeypatch.setattr(page, "draw_plot", lambda plot: b"<svg/>")


@pytest.fixture
def frames() -> Callable[[int, int], Iterator[Sample]]:
    """Makes the frames of a seed."""
    return make_frames


@pytest.fixture
def read_bags(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Bags are made up: a file named N.mcap gives the frames of seed N. The list is of what was read."""
    read: list[Path] = []

    def read_samples(path: Path, settings: DriveSettings, warn: Callable[[str], None]) -> Iterator[Sample]:
        read.append(path)
        return make_frames(int(path.stem), 6)

    monkeypatch.setattr(cache, "read_samples", read_samples)
    return read


@pytest.fixture
def make_bags(tmp_path: Path, read_bags: list[Path]) -> Callable[[int], list[Path]]:
    """Paths of made-up bags."""

    def make(count: int) -> list[Path]:
        folder = tmp_path / "bags"
        folder.mkdir(exist_ok=True)
        bags = [folder / f"{index}.mcap" for index in range(count)]
        for bag in bags:
            bag.write_bytes(b"made up")
        return bags

    return make


@pytest.fixture
def drive(tmp_path: Path, make_bags: Callable[[int], list[Path]]) -> CachedDrive:
    """A cached drive of six frames of 64 x 128 pixels."""
    build_drive(make_bags(1)[0], tmp_path / "drive", CacheSettings(630.0, 100.0))
    return CachedDrive(tmp_path / "drive")
