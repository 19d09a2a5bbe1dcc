"""Trainings in processes of their own: killed at any moment, or sharing each batch."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import random
import signal
import socket
import time
from collections.abc import Mapping
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
import torch
from small_training import CONFIG, RECIPE, train_here

from radcam_depth_ros.training.curves import read_metrics
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.recipe import PhaseConfig, TrainingConfig

ENDLESS_S = 600.0

# Forked from a process that has imported all, and used no thread of it: they start at once.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["small_training"])


def start(
    config: TrainingConfig,
    drive: Path,
    folder: Path,
    network: str = "miniature",
    resume: bool = False,
    environment: Mapping[str, str] | None = None,
    lingers: bool = False,
    grows: bool = False,
) -> BaseProcess:
    arguments = (network, config, drive, folder, resume, environment or {}, lingers, grows)
    process = CONTEXT.Process(target=train_here, args=arguments)
    process.start()
    return process


def finish(*processes: BaseProcess) -> None:
    for process in processes:
        process.join(ENDLESS_S)
        assert process.exitcode == 0


def record(folder: Path) -> list[dict[str, Any]]:
    """The curves of a run, without the time that it took."""
    lines = read_metrics(folder / "metrics.jsonl")
    return [{name: value for name, value in line.items() if name != "minutes"} for line in lines]


@pytest.mark.exhaustive
@pytest.mark.timeout(400)  # four processes after one another, on a machine that may be busy
def test_a_run_that_is_killed_again_and_again_gives_the_same_curves_and_weights(
    tmp_path: Path, drive: CachedDrive
) -> None:
    config = dataclasses.replace(
        CONFIG,
        iterations=24,
        precision="float32",
        log_every_iterations=1,
        checkpoint_every_minutes=0.001,  # between validations as well
        phases=(PhaseConfig(0.5, ((64, 64),), 2), PhaseConfig(0.5, ((64, 96),), 2)),
        validation=replace(RECIPE.validation, every_iterations=8, frames=1),
    )
    place = tmp_path / "drive"
    finish(start(config, place, tmp_path / "whole"))
    rng = random.Random(0)
    folder = tmp_path / "killed"
    for share in (0.15, 0.5, 0.8):
        process = start(config, place, folder, resume=(folder / "last.pt").is_file(), lingers=True)
        while len(record(folder)) < share * config.iterations:
            assert process.is_alive()
            time.sleep(0.005)
        time.sleep(rng.uniform(0, 0.1))
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join(ENDLESS_S)
        assert process.exitcode == -signal.SIGKILL
    finish(start(config, place, folder, resume=True))
    assert record(folder) == record(tmp_path / "whole")
    whole, killed = (torch.load(run / "0.pt") for run in (tmp_path / "whole", folder))
    for name, value in whole["weights"].items():
        assert torch.equal(value, killed["weights"][name]), name
    names = ("miniature.yaml", "miniature.safetensors")
    assert all((folder / name).read_bytes() == (tmp_path / "whole" / name).read_bytes() for name in names)


@pytest.mark.timeout(400)  # three processes that share what a busy machine leaves them
@pytest.mark.parametrize(
    ("network", "iterations", "grows"), [("miniature", 5, False), ("miniature", 9, True), ("baff", 1, False)]
)
def test_two_processes_learn_what_one_does_with_the_joint_batch(
    network: str, iterations: int, grows: bool, tmp_path: Path, drive: CachedDrive
) -> None:
    config = dataclasses.replace(
        CONFIG,
        iterations=iterations,
        joint_norms=True,
        precision="float32",
        log_every_iterations=1,
        phases=(PhaseConfig(1.0, ((64, 64),), 4),),
        optimiser=replace(RECIPE.optimiser, warm_up_iterations=2),
        validation=replace(RECIPE.validation, every_iterations=100, frames=1),
    )
    place = tmp_path / "drive"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    shared = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "WORLD_SIZE": "2"}
    finish(
        start(config, place, tmp_path / "one", network, grows=grows),
        *(
            start(config, place, tmp_path / "two", network, environment={**shared, "RANK": rank}, grows=grows)
            for rank in "01"
        ),
    )
    one, first, second = (torch.load(tmp_path / name) for name in ("one/0.pt", "two/0.pt", "two/1.pt"))
    for name, value in first["weights"].items():
        assert torch.equal(value, second["weights"][name]), name
    # AdamW makes a step as long as the rate of any gradient, be it rounding alone: hence what is tolerated of weights.
    tolerated = 0.01 if network == "miniature" else 2.0
    steps = iterations * config.optimiser.learning_rate
    for name, value in one["weights"].items():
        torch.testing.assert_close(first["weights"][name], value, rtol=1e-3, atol=tolerated * steps, msg=name)
    squared = sum(float(value.square().sum()) for value in one["gradients"].values() if value is not None)
    for name, value in one["gradients"].items():
        if value is not None:
            torch.testing.assert_close(first["gradients"][name], value, rtol=1e-3, atol=1e-5 * squared**0.5, msg=name)
    for mine, theirs in zip(record(tmp_path / "one"), record(tmp_path / "two"), strict=True):
        assert {name for name, value in mine.items() if value is None} == {
            name for name, value in theirs.items() if value is None
        }
        for name, value in mine.items():
            assert theirs[name] == (pytest.approx(value, rel=1e-4, abs=1e-4) if isinstance(value, float) else value)
    assert sorted(path.name for path in (tmp_path / "one").iterdir() if path.suffix != ".pt") == sorted(
        path.name for path in (tmp_path / "two").iterdir() if path.suffix != ".pt"
    )
