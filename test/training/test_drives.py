from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pytest

from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.drives import load_data, refuse_test_drives
from radcam_depth_ros.training.errors import TrainingError

SETTINGS = CacheSettings(630.0, 100.0)
Prepare = Callable[[Sequence[Path]], Sequence[CachedDrive]]


@pytest.fixture
def prepare(tmp_path: Path) -> Prepare:
    return partial(cached_drives, folder=tmp_path / "cache", settings=SETTINGS)


def test_drives_for_measuring_are_refused() -> None:
    refuse_test_drives([Path("drives/seed_999999.mcap"), Path("rosbag2_20261121_101500"), Path("rosbag2_2026_11_21")])
    with pytest.raises(TrainingError, match="kept for measuring"):
        refuse_test_drives([Path("drives/seed_1000019.mcap")])


def test_some_bags_are_held_out(tmp_path: Path, make_bags: Callable[[int], list[Path]]) -> None:
    ready: list[Path] = []
    data = load_data(
        make_bags(5), [], 0.2, partial(cached_drives, folder=tmp_path / "cache", settings=SETTINGS, on_bag=ready.append)
    )
    assert (len(data.train), len(data.validation)) == (24, 6)
    assert {drive.card.source for drive in data.train.drives}.isdisjoint(
        drive.card.source for drive in data.validation.drives
    )
    assert len(ready) == 5
    assert "24 frames of 4 bags" in data.description


def test_of_a_single_bag_the_last_frames_are_held_out(prepare: Prepare, make_bags: Callable[[int], list[Path]]) -> None:
    data = load_data(make_bags(1), [], 0.2, prepare)
    assert (len(data.train), len(data.validation)) == (5, 1)


def test_a_bag_cannot_both_teach_and_judge(prepare: Prepare, make_bags: Callable[[int], list[Path]]) -> None:
    bags = make_bags(2)
    with pytest.raises(TrainingError, match="among the training and the validation bags"):
        load_data(bags, bags[:1], 0.1, prepare)
    data = load_data(bags[:1], bags[1:], 0.1, prepare)
    assert (len(data.train), len(data.validation)) == (6, 6)
