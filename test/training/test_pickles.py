"""A pickle that calls anything is refused with one sentence, and what it calls is not called."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from radcam_depth_ros import networks
from radcam_depth_ros.training.checkpoint import (
    AveragedWeights,
    RunState,
    Working,
    before,
    load_checkpoint,
    save_checkpoint,
)
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.initial import load_backbones


class Malicious:
    """Makes a file when it is unpickled."""

    def __init__(self, made: Path) -> None:
        self._made = made

    def __reduce__(self) -> Any:
        return os.mkdir, (str(self._made),)


def zipped(content: object, path: Path) -> None:
    torch.save(content, path)


def bare(content: object, path: Path) -> None:
    path.write_bytes(pickle.dumps(content, protocol=2))


def of_another_protocol(content: object, path: Path) -> None:
    path.write_bytes(pickle.dumps(content, protocol=4))


def working() -> Working:
    network = nn.Linear(2, 2)
    return Working(network, AveragedWeights(network, 0.9), torch.optim.AdamW(network.parameters()))


def check(sentence: str, path: Path, made: Path) -> None:
    assert str(path) in sentence
    assert "\n" not in sentence
    assert "weights_only" not in sentence  # torch advises to leave the check out
    assert not made.exists()


WRITERS = pytest.mark.parametrize("write", [zipped, bare, of_another_protocol])


def test_the_pickle_of_these_tests_does_harm_where_it_is_read(tmp_path: Path) -> None:
    made = tmp_path / "made"
    pickle.loads(pickle.dumps(Malicious(made)))
    assert made.is_dir()


@WRITERS
def test_a_malicious_checkpoint_is_refused(tmp_path: Path, write: Callable[..., None]) -> None:
    path, made = tmp_path / "last.pt", tmp_path / "made"
    write({"state": {}, "network": Malicious(made)}, path)
    with pytest.raises(TrainingError, match="nothing of it was run") as refused:
        load_checkpoint(path, working())
    check(str(refused.value), path, made)
    assert ("posix.mkdir" in str(refused.value)) == (write is not of_another_protocol)  # which is not read so far


def test_a_run_goes_on_from_the_checkpoint_before_a_malicious_one(tmp_path: Path) -> None:
    path, made, notes = tmp_path / "last.pt", tmp_path / "made", list[str]()
    save_checkpoint(before(path), RunState(step=3), working())
    zipped(Malicious(made), path)
    assert load_checkpoint(path, working(), notes.append).step == 3
    assert "mkdir" in notes[0]
    assert not made.exists()


@WRITERS
def test_malicious_backbone_weights_are_refused(tmp_path: Path, write: Callable[..., None]) -> None:
    path, made = tmp_path / "mobilenet_v2.pth", tmp_path / "made"
    write({"features.0.0.weight": Malicious(made)}, path)
    network = networks.create("baff", {"context": "mobilenet_v2"})
    with pytest.raises(TrainingError, match="nothing of it was run") as refused:
        load_backbones(network, str(path))
    check(str(refused.value), path, made)
    assert ("posix.mkdir" in str(refused.value)) == (write is not of_another_protocol)  # which is not read so far
