from __future__ import annotations

from pathlib import Path

import pytest
import torch
from disks import full_disk
from torch import nn

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.training.checkpoint import (
    AveragedWeights,
    RecentLosses,
    RunState,
    Working,
    before,
    load_checkpoint,
    save_checkpoint,
)
from radcam_depth_ros.training.errors import TrainingError


def make_working(value: float = 0.0) -> Working:
    network = nn.Linear(64, 64)
    nn.init.constant_(network.weight, value)
    return Working(network, AveragedWeights(network, 0.9), torch.optim.AdamW(network.parameters()))


def test_all_of_a_run_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "last.pt"
    state = RunState(step=7, position=28, best_score=1.5, worse=2, recent=RecentLosses({"total": 3.0}, 2))
    working = make_working(0.5)
    working.initial["weight"] = torch.ones(2)
    save_checkpoint(path, state, working)
    other = make_working()
    assert load_checkpoint(path, other) == state
    assert torch.equal(other.network.weight, working.network.weight)
    assert torch.equal(other.initial["weight"], torch.ones(2))


def test_a_full_disk_leaves_the_checkpoint_before_intact(tmp_path: Path) -> None:
    path = tmp_path / "last.pt"
    save_checkpoint(path, RunState(step=1), make_working())
    content = path.read_bytes()
    with full_disk(4096), pytest.raises(RadcamDepthError, match=r"cannot write .*last\.pt"):
        save_checkpoint(path, RunState(step=2), make_working())
    assert path.read_bytes() == content
    assert [file.name for file in tmp_path.iterdir()] == ["last.pt"]


@pytest.mark.parametrize("damage", ["nothing", "half", "noise", "missing"])
def test_a_damaged_checkpoint_gives_way_to_the_one_before(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "last.pt"
    for step in (1, 2):
        save_checkpoint(path, RunState(step=step), make_working(step))
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes({"nothing": b"", "half": content[: len(content) // 2], "noise": b"no checkpoint"}[damage])
    notes: list[str] = []
    working = make_working()
    assert load_checkpoint(path, working, notes.append).step == 1
    assert float(working.network.weight.detach()[0, 0]) == 1
    assert len(notes) == (0 if damage == "missing" else 1)
    assert all("going on from last.before.pt, iteration 1" in note for note in notes)
    before(path).write_bytes(b"damaged as well")
    if damage != "missing":
        with pytest.raises(TrainingError, match="cannot be resumed"):
            load_checkpoint(path, working)


def test_a_checkpoint_of_another_network_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "last.pt"
    save_checkpoint(path, RunState(), make_working())
    network = nn.Linear(3, 3)
    other = Working(network, AveragedWeights(network, 0.9), torch.optim.AdamW(network.parameters()))
    with pytest.raises(TrainingError, match="size mismatch"):
        load_checkpoint(path, other)
