from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

import pytest

from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.growth import Growth
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.errors import TrainingError

SETTINGS = CacheSettings(630.0, 100.0)


class Look:
    """Finds what it is told to find, and says when it has looked again after that."""

    def __init__(self) -> None:
        self.bags: list[str] = []
        self.fails = False
        self._looked = Event()

    def __call__(self) -> Sequence[str]:
        self._looked.set()
        if self.fails:
            raise TrainingError("the place cannot be reached")
        return list(self.bags)

    def wait(self) -> None:
        """Until two more looks have begun: the first of them is over then."""
        for _ in range(2):
            self._looked.clear()
            assert self._looked.wait(20)


def test_bags_that_come_are_prepared_once(tmp_path: Path, make_bags: Callable[[int], list[Path]]) -> None:
    bags, look, notes = [str(bag) for bag in make_bags(4)], Look(), list[str]()
    look.bags = bags[:2]

    def prepare(found: Sequence[Path]) -> Sequence[CachedDrive]:
        if any(bag.stem == "2" for bag in found):
            raise TrainingError("has no ground truth")
        return cached_drives(found, tmp_path / "cache", SETTINGS)

    with Growth(look, prepare, {bags[0]}, notes.append, 0.001) as growth:
        look.wait()
        (folder,) = growth.take()
        assert CachedDrive(folder).card.source == bags[1]
        assert growth.take() == ()
        look.fails = True
        look.wait()
        look.fails, look.bags = False, bags
        look.wait()
        (folder,) = growth.take()
        assert CachedDrive(folder).card.source == bags[3]
    assert notes == [f"{bags[2]} is left out: has no ground truth"]


def test_a_thread_ends_with_its_context() -> None:
    look = Look()
    with Growth(look, lambda bags: (), (), pytest.fail, 0.001) as growth:
        look.wait()
    assert not growth._thread.is_alive()
