from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import ablation, short_training
from benchmarks.ablation import COLUMNS, EMBEDDING, ERRORS, FORMS, NONE, REGIONS, relative, time_associations
from benchmarks.thinned_bags import thinned_bags
from radcam_depth_ros import networks
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.cli import app
from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.training.fit import CHECKPOINT


@pytest.mark.parametrize("name", FORMS)
def test_each_form_can_be_built(name: str) -> None:
    config = networks.create("baff", FORMS[name].architecture).config
    switches = (config.bidirectional, config.channel_attention, config.position_attention)
    if FORMS[name].has_few_returns:
        assert switches == (True, True, True)
        assert config.association == name.partition(",")[0]
    else:
        parts = {"BF", "CA", "PA"} if name == "all" else set(name.split("+"))
        assert switches == ("BF" in parts, "CA" in parts, "PA" in parts)


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Trainings run in this process; the list is of their commands."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command[3:])
        result = CliRunner().invoke(app, command[3:])
        return subprocess.CompletedProcess(command, result.exit_code)

    monkeypatch.setattr(short_training.subprocess, "run", run)
    return commands


@pytest.fixture
def command(tmp_path: Path, write_drive: Callable[..., Path]) -> list[str]:
    """Of the smallest ablation that there can be."""
    words = ["ablation"]
    for option, name in (("--bags", "train"), ("--validation-bags", "validation"), ("--test-bags", "1000000")):
        words += [option, str(write_drive(tmp_path / f"{name}.mcap", frames=2))]
    words += ["--iterations", "1", "--batch", "1", "--crop", "64x64", "--frames", "2", "--returns", "2"]
    return [*words, "--seeds", "1", "--time-returns", "--out", str(tmp_path / "out")]


def run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setattr(sys, "argv", words)
    ablation.main()
    out = Path(words[words.index("--out") + 1])
    figures: dict[str, Any] = json.loads((out / "ablation.json").read_text(encoding="utf-8"))
    return figures


def test_what_is_done_is_not_done_again(
    command: list[str], trained: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run([*command, "--forms", NONE, "all"], monkeypatch)
    assert len(trained) == 2
    for form in (NONE, "all"):
        assert set(first["forms"][form]["mean"]) == set(COLUMNS)
        assert all(np.isfinite(first["forms"][form]["mean"][column]) for column in ERRORS)
        assert first["forms"][form]["spread"]["mae_80"] is None
    assert first["forms"][NONE]["relative"]["mae_80"] == [0.0, None]
    # A run that was cut off before its first checkpoint begins again, one with a checkpoint goes on.
    (tmp_path / "out" / "all_0" / "baff.safetensors").unlink()
    (tmp_path / "out" / "none_0" / "baff.safetensors").unlink()
    (tmp_path / "out" / "none_0" / CHECKPOINT).unlink()
    again = run([*command, "--forms", NONE, "all", "--seeds", "2"], monkeypatch)
    assert ["--resume" in words for words in trained[2:4]] == [False, True]
    assert len(trained) == 6
    assert set(again["forms"]["all"]["seeds"]) == {"0", "1"}
    assert again["forms"]["all"]["spread"]["mae_80"] >= 0
    assert run([*command, "--forms", NONE, "all", "--seeds", "2"], monkeypatch) == again
    assert len(trained) == 6
    with pytest.raises(SystemExit, match="trained by another recipe"):
        run([*command, "--forms", NONE, "--iterations", "2"], monkeypatch)


def test_regions_are_held_against_embedding(
    command: list[str], trained: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = run([*command, "--forms", EMBEDDING, REGIONS], monkeypatch)
    assert figures["forms"][REGIONS]["against"] == EMBEDDING
    assert all("few_returns" in words[words.index("--validation-bags") + 1] for words in trained)
    assert np.isfinite(figures["forms"][REGIONS]["relative"]["rmse_80"][0])


def test_a_training_that_fails_is_said(
    command: list[str], trained: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit, match=r"none_0 ended with exit code 1; .*none_0.log says why"):
        run([*command, "--forms", NONE, "--crop", "63x64"], monkeypatch)


def test_changes_are_means_over_common_seeds() -> None:
    errors = {NONE: {0: {"mae_80": 2.0}, 1: {"mae_80": 4.0}}, "BF": {1: {"mae_80": 3.0}, 0: {"mae_80": 2.0}, 2: {}}}
    mean, spread = relative(errors, "BF", "mae_80")
    assert mean == pytest.approx((-0.25 + 0.0) / 2)
    assert spread == pytest.approx(np.std([-0.25, 0.0], ddof=1))
    assert relative({"BF": {0: {"mae_80": 2.0}}}, "BF", "mae_80") == (None, None)


def test_both_associations_are_timed() -> None:
    (row,) = time_associations((64, 96), [3], 2)
    assert row["returns"] == 3
    assert row["times_embedding"] > 0
    assert row["regions_gflop"] > row["embedding_gflop"] > 0


def test_thinned_bags_have_few_returns(tmp_path: Path, write_drive: Callable[..., Path]) -> None:
    bag = write_drive(tmp_path / "drive.mcap", frames=3)
    (copy,) = thinned_bags([bag], tmp_path / "few", 2)
    written = copy.stat().st_mtime_ns
    assert thinned_bags([bag], tmp_path / "few", 2) == (copy,)
    assert copy.stat().st_mtime_ns == written
    for sample, thin in zip(read_samples(bag), read_samples(copy), strict=True):
        assert len(thin.frame.radar) == 2
        whole = {tuple(point) for point in sample.frame.radar.xyz_m}
        assert {tuple(point) for point in thin.frame.radar.xyz_m} < whole
        assert np.isfinite(thin.frame.radar.rcs_dbsm).all()
        np.testing.assert_array_equal(thin.frame.image, sample.frame.image)
    with BagReader(bag) as reader, BagReader(copy) as copied:
        assert reader.topics == copied.topics
