from __future__ import annotations

import math
import sys
import types
from pathlib import Path

import pytest

from radcam_depth_ros.training.curves import MetricsLog, read_metrics, require_tensorboard
from radcam_depth_ros.training.errors import TrainingError


def test_lines_are_added_and_those_of_a_run_that_was_cut_off_dropped(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    log = MetricsLog(path, None)
    log.add("train", 2, {"total": 1.0, "dense": math.nan})
    log.add("train", 4, {"total": 0.5})
    with path.open("a") as file:
        file.write('{"kind": "tr')
    MetricsLog(path, 3)
    assert read_metrics(path) == [{"kind": "train", "step": 2, "total": 1.0, "dense": None}]
    MetricsLog(path, None)
    assert read_metrics(path) == []


def test_tensorboard_is_told_what_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[object] = []

    class SummaryWriter:
        def __init__(self, folder: str, purge_step: int) -> None:
            told.append((Path(folder).name, purge_step))

        def add_scalar(self, name: str, value: float, step: int) -> None:
            told.append((name, value, step))

        def flush(self) -> None:
            told.append("flush")

    module = types.ModuleType("torch.utils.tensorboard")
    module.SummaryWriter = SummaryWriter  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    log = MetricsLog(tmp_path / "metrics.jsonl", 3, tensorboard=True)
    log.add("train", 4, {"total": 0.5})
    assert told == [("tensorboard", 4), ("train/total", 0.5, 4), "flush"]


def test_tensorboard_that_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(TrainingError, match="TensorBoard is not installed"):
        require_tensorboard()
