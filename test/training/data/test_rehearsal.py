from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from small_training import RECIPE

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.configuration import ConfigurationError
from radcam_depth_ros.training.data.rehearsal import rehearsal_drives

TINY = {
    "key_frames": True,
    "camera": {"rate_hz": 1.0, "width": 64, "height": 32, "edge_samples": 0},
    "lidar": {"enabled": False},
    "world": {"view_m": 100.0},
}


def test_drives_are_simulated_once(tmp_path: Path) -> None:
    config = replace(RECIPE.rehearsal, share=0.5, frames=2, frames_per_drive=1, first_seed=4, simulation=TINY)
    ready: list[None] = []
    bags = rehearsal_drives(config, tmp_path, on_drive=lambda: ready.append(None))
    assert [bag.name for bag in bags] == ["seed_4.mcap", "seed_5.mcap"]
    assert len(ready) == 2
    changed = [bag.stat().st_mtime_ns for bag in bags]
    assert rehearsal_drives(config, tmp_path) == bags
    assert [bag.stat().st_mtime_ns for bag in bags] == changed
    with BagReader(bags[0]) as reader:
        assert "/ground_truth/depth" in {message.topic for message in reader.messages()}


def test_a_mistake_in_the_simulation_is_told_before_anything_is_simulated(tmp_path: Path) -> None:
    config = replace(RECIPE.rehearsal, simulation={"camra": {}})
    with pytest.raises(ConfigurationError, match=r"rehearsal\.simulation: unknown key camra; did you mean camera"):
        rehearsal_drives(config, tmp_path / "cache")
    assert not (tmp_path / "cache").exists()
