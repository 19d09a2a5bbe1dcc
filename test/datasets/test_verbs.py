"""Imported scenes in the other verbs."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from command_line import run_main

from radcam_depth_ros.bags import BagReader, find_bags
from radcam_depth_ros.datasets import LAYOUTS, ImportOptions, import_scenes, plan_import

DATAROOT = os.environ.get("NUSCENES_DATAROOT", "")
VERSION = "v1.0-mini"


@pytest.fixture(scope="module")
def scene(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("scene")
    plan = plan_import(LAYOUTS["nuscenes"], whole_set, out, ImportOptions(), version=VERSION, names=("scene-0001",))
    assert not any(scene.problem for scene in import_scenes(plan))
    return out / "scene-0001.mcap"


def test_inspect_finds_all_that_is_needed(scene: Path, tmp_path: Path, monkeypatch: Any, capfd: Any) -> None:
    assert run_main(monkeypatch, "inspect", scene, "--write-params", tmp_path / "vehicle.yaml") == 0
    assert "nothing is missing" in capfd.readouterr().out
    assert "/camera/front/image_raw" in (tmp_path / "vehicle.yaml").read_text()


def test_replay_gives_depth_of_every_image(scene: Path, tmp_path: Path, small_weights: Path, monkeypatch: Any) -> None:
    out = tmp_path / "depth.mcap"
    assert run_main(monkeypatch, "replay", scene, out, "--model", small_weights) == 0
    with BagReader(out) as reader:
        counts = {info.name: info.count for info in reader.topics if info.type_name.endswith("/Image")}
    assert 14 in counts.values()


def test_evaluate_and_check_calibration_read_it(
    scene: Path, tmp_path: Path, small_weights: Path, monkeypatch: Any, capfd: Any
) -> None:
    target = tmp_path / "figures.json"
    options = ("--model", small_weights, "--no-baselines", "--json", target)
    assert run_main(monkeypatch, "evaluate", scene, *options) == 0
    figures = json.loads(target.read_text())
    assert (figures["frames"], figures["ground_truth"], figures["given"]["road_share"]) == (14, "lidar", 1.0)
    assert set(figures["by_weather"]) == {"dry"}
    # Whatever the verdict on a drive of noise: no input is refused.
    assert run_main(monkeypatch, "check-calibration", scene) in (0, 1)
    assert "radcam-depth:" not in capfd.readouterr().err


@pytest.mark.skipif(
    not DATAROOT, reason="NUSCENES_DATAROOT names no folder of nuScenes: the data cannot be had everywhere"
)
@pytest.mark.timeout(3600)
def test_the_mini_set_itself(tmp_path: Path, monkeypatch: Any) -> None:
    out, target = tmp_path / "scenes", tmp_path / "figures.json"
    options = ("--version", VERSION, "--images", "keyframes")
    assert run_main(monkeypatch, "import", "nuscenes", DATAROOT, out, *options) == 0
    assert len(find_bags([out])) == 10
    assert run_main(monkeypatch, "evaluate", out, "--protocol", "cafnet", "--json", target) == 0
    figures = json.loads(target.read_text())
    assert figures["frames"] == 404 - 10  # 404 key frames, without the last one of each scene
    assert 0 < figures["groups"]["all"]["80"]["mae"] < 40
