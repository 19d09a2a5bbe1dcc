"""A part whose extra is not installed says so in one sentence, which names the extra."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from radcam_depth_ros import node
from radcam_depth_ros.cli import main
from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.on_ray import ray_engine
from radcam_depth_ros.storage import StorageError, folder_at
from radcam_depth_ros.training.curves import require_tensorboard
from radcam_depth_ros.training.data import rehearsal
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.recipe import recipe_of
from radcam_depth_ros.training.resident.choice import maker_of

ROOT = Path(__file__).parents[1]


@pytest.fixture
def take_away(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Lets a package be missing, and rooms that import it be imported anew."""

    def without(package: str, *rooms: str) -> None:
        for room in rooms:
            full = f"radcam_depth_ros.{room}"
            for name in [name for name in sys.modules if name == full or name.startswith(f"{full}.")]:
                monkeypatch.delitem(sys.modules, name)
            parent, _, child = full.rpartition(".")
            monkeypatch.delattr(sys.modules[parent], child, raising=False)
        monkeypatch.setitem(sys.modules, package, None)

    return without


def end_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What a verb that cannot run prints."""
    monkeypatch.setattr(sys, "argv", ["radcam-depth", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_extras_that_are_named_exist() -> None:
    offered = re.findall(r'^        "(\w+)": \[', (ROOT / "setup.py").read_text(encoding="utf-8"), re.M)
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "radcam_depth_ros").rglob("*.py")]
    named = {name for text in sources for name in re.findall(r"install_extra\(['\"](\w+)['\"]\)", text)}
    assert {"fleet", "ros", "sim", "train"} <= named <= {*offered}


def test_simulate(
    tmp_path: Path, take_away: Callable[..., None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    take_away("embreex", "simulation")
    said = end_of(monkeypatch, capsys, "simulate", str(tmp_path / "drive"), "--frames", "1")
    assert said.count("\n") == 1
    assert install_extra("sim") in said


def test_export_to_onnx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    said = end_of(monkeypatch, capsys, "export", str(tmp_path / "baff.onnx"))
    assert said.count("\n") == 1
    assert install_extra("onnx") in said


def test_play_and_view(
    tmp_path: Path, take_away: Callable[..., None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (("play", str(tmp_path)), ("view", "topics", "--save", str(tmp_path / "strip.png"))):
        take_away("rclpy", "bag_player", "live_topics")
        said = end_of(monkeypatch, capsys, *words)
        assert said.count("\n") == 1
        assert install_extra("ros") in said


def test_the_node(take_away: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    take_away("rclpy", "node.process")
    with pytest.raises(SystemExit) as ended:
        node.main([])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert install_extra("ros") in said


def test_rehearsal(tmp_path: Path, take_away: Callable[..., None]) -> None:
    config = rehearsal.RehearsalConfig(0.5, 0.15, 16, 8, 1, 0.1, {})
    take_away("embreex", "simulation")
    with pytest.raises(TrainingError, match=re.escape(install_extra("train"))):
        rehearsal.rehearsal_drives(config, tmp_path)


def test_tensorboard(take_away: Callable[..., None]) -> None:
    take_away("torch.utils.tensorboard")
    with pytest.raises(TrainingError, match=re.escape(install_extra("train"))):
        require_tensorboard()


def test_ray(take_away: Callable[..., None]) -> None:
    take_away("ray")
    with pytest.raises(FleetError, match=re.escape(install_extra("fleet"))):
        ray_engine("ray")


def test_s3(take_away: Callable[..., None]) -> None:
    take_away("s3fs")
    with pytest.raises(StorageError, match=re.escape(install_extra("fleet"))):
        folder_at("s3://bucket/drives")


def test_samples_on_a_device(take_away: Callable[..., None]) -> None:
    modules = ("batches", "photometric", "appearance")
    for package in ("kornia", "kornia.filters", "kornia.color"):
        take_away(package, *(f"training.resident.{name}" for name in modules))
    samples: Any = None
    with pytest.raises(TrainingError, match=re.escape(install_extra("train"))):
        maker_of("device", torch.device("cpu"), samples, recipe_of("baff").augmentation, 0)
