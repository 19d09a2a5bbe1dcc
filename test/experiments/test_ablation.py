from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from small_training import RECIPE
from typer.testing import CliRunner

from experiments import ablation, short_training
from experiments.ablation import COLUMNS, ERRORS, relative, time_associations
from experiments.forms import ALL, EMBEDDING, FORMS, NONE, REGIONS, SEG, forms_of
from experiments.short_training import Budget, ShortTraining
from experiments.thinned_bags import thinned_bags
from radcam_depth_ros import networks
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.cli import app
from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.fit import CHECKPOINT, METRICS
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.recipe import build, load


@pytest.mark.parametrize("name", FORMS)
def test_each_form_has_a_recipe_and_one_to_be_held_against(name: str) -> None:
    form = FORMS[name]
    recipe = build(form.recipe, name)
    assert Criterion.of(form.network, recipe.loss)
    assert registry.create_config(form.network, form.architecture)
    reference = FORMS[form.against]
    assert (reference.network, reference.against) == (form.network, form.against) or form.against in (SEG, ALL)
    assert name in forms_of(form.network)


def test_each_term_of_the_distillation_is_taught_alone() -> None:
    terms = ("image", "radar", "decoder", "inter_depth")
    for term in terms:
        recipe = FORMS[f"taught: {term.replace('_', '-')}"].recipe
        config = build(recipe, term).distillation
        assert [name for name in terms if getattr(config, name) > 0] == [term]
    assert build(FORMS["taught"].recipe, "all") == RECIPE


@pytest.mark.parametrize("name", forms_of("baff"))
def test_each_form_of_baff_has_its_parts(name: str) -> None:
    config = networks.create("baff", FORMS[name].architecture).config
    switches = (config.bidirectional, config.channel_attention, config.position_attention)
    if FORMS[name].has_few_returns:
        assert switches == (True, True, True)
        assert config.association == name.partition(",")[0]
    else:
        parts = {"BF", "CA", "PA"} if name.partition(",")[0] == ALL else set(name.split("+"))
        assert switches == ("BF" in parts, "CA" in parts, "PA" in parts)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Nothing is trained: a started training leaves random weights and a validation. The list is of the commands."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        commands.append(command)
        folder = Path(command[command.index("--out") + 1])
        folder.mkdir(parents=True, exist_ok=True)
        if "fails" in folder.parts:
            return subprocess.CompletedProcess(command, 2)
        recipe = yaml.safe_load(folder.with_name(f"{folder.name}.yaml").read_text(encoding="utf-8"))
        torch.manual_seed(recipe["seed"])
        name = command[command.index("--network") + 1] if "--network" in command else "baff"
        network = networks.create(name, recipe["architecture"])
        archive.save(network, archive.Card.of(network, name, "nothing"), folder / f"{name}.safetensors")
        (folder / CHECKPOINT).touch()
        rows = ({"kind": "train", "step": 1}, {"kind": "validation", "step": 1, "mae_80_m": 2.5})
        (folder / METRICS).write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="utf-8")
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(short_training.subprocess, "run", run)
    return commands


def make_training(folder: Path, iterations: int = 20) -> ShortTraining:
    budget = Budget((Path("a"), Path("b")), (Path("c"),), Path("cache"), iterations)
    return ShortTraining(folder, budget, "baff", {"bidirectional": False})


def test_a_training_is_done_once(tmp_path: Path, started: list[list[str]]) -> None:
    training = make_training(tmp_path / "run")
    assert training.run()["mae_80_m"] == 2.5
    assert training.run()["mae_80_m"] == 2.5
    (command,) = started
    assert [command[index + 1] for index, word in enumerate(command) if word == "--bags"] == ["a", "b"]
    assert "--resume" not in command
    recipe = load(Path(command[command.index("--config") + 1]))
    assert (recipe.iterations, recipe.phases[0].batch, recipe.architecture) == (20, 4, {"bidirectional": False})
    with pytest.raises(SystemExit, match="trained by another recipe"):
        make_training(tmp_path / "run", iterations=30).run()


def test_a_training_that_was_cut_off_goes_on(tmp_path: Path, started: list[list[str]]) -> None:
    training = make_training(tmp_path / "run")
    training.run()
    (tmp_path / "run" / METRICS).unlink()
    training.run()
    assert "--resume" in started[1]
    assert "--bags" not in started[1]
    # Before its first checkpoint there is nothing to go on with.
    (tmp_path / "run" / METRICS).unlink()
    (tmp_path / "run" / CHECKPOINT).unlink()
    training.run()
    assert "--resume" not in started[2]
    assert len(started) == 3


def test_a_training_that_fails_is_said(tmp_path: Path, started: list[list[str]]) -> None:
    with pytest.raises(SystemExit, match=r"run ended with exit code 2; .*run.log says why"):
        make_training(tmp_path / "fails" / "run").run()


@pytest.fixture
def ablate(tmp_path: Path, write_drive: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Runs the command on small drives and gives its figures."""
    words = ["ablation"]
    for option, name in (("--bags", "train"), ("--validation-bags", "validation"), ("--test-bags", "1000000")):
        words += [option, str(write_drive(tmp_path / f"{name}.mcap", frames=2))]
    words += ["--iterations", "1", "--batch", "2", "--crop", "64x64", "--frames", "2", "--returns", "2"]
    words += ["--out", str(tmp_path / "out"), "--time-returns"]

    def run(*more: str) -> Any:
        monkeypatch.setattr(sys, "argv", [*words, *more])
        ablation.main()
        return json.loads((tmp_path / "out" / "ablation.json").read_text(encoding="utf-8"))

    return run


def test_forms_are_held_against_none(ablate: Callable[..., Any], started: list[list[str]]) -> None:
    chosen = ("--forms", NONE, "all", "--seeds", "2")
    figures = ablate(*chosen)
    assert len(started) == 4
    for form in (NONE, "all"):
        entry = figures["forms"][form]
        assert set(entry["seeds"]) == {"0", "1"}
        assert set(entry["mean"]) == set(COLUMNS)
        assert all(math.isfinite(entry["mean"][column]) for column in ERRORS)
        assert entry["against"] == NONE
    assert figures["forms"][NONE]["relative"]["mae_80"] == {"mean": 0.0, "spread": 0.0}
    assert figures["forms"]["all"]["spread"]["mae_80"] > 0
    assert ablate(*chosen) == figures
    assert len(started) == 4


def test_forms_start_from_a_backbone_but_those_that_begin_at_random(
    ablate: Callable[..., Any], started: list[list[str]]
) -> None:
    forms = (ALL, "all, random features", "all, enlarged linearly")
    figures = ablate("--forms", *forms, "--seeds", "1", "--backbone-weights", "imagenet")
    assert [command[-2:] == ["--backbone-weights", "imagenet"] for command in started] == [True, False, True]
    assert {figures["forms"][form]["against"] for form in forms[1:]} == {ALL}


def test_taught_forms_need_a_teacher(tmp_path: Path, ablate: Callable[..., Any], started: list[list[str]]) -> None:
    chosen = ("--network", "lircdepth", "--forms", "alone", "taught: radar", "--seeds", "1", "--first-seed", "3")
    with pytest.raises(SystemExit, match="taught: radar learns from a teacher: give its weight file with --teacher"):
        ablate(*chosen)
    figures = ablate(*chosen, "--teacher", str(tmp_path / "cafnet.safetensors"))
    assert ["--teacher" in command for command in started] == [False, True]
    assert set(figures["forms"]["taught: radar"]["seeds"]) == {"3"}
    assert figures["forms"]["taught: radar"]["against"] == "alone"


def test_a_form_is_trained_and_regions_too(ablate: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(
            command, CliRunner().invoke(app, [*command[3:], "--processes", "1"]).exit_code
        )

    monkeypatch.setattr(short_training.subprocess, "run", run)
    figures = ablate("--forms", REGIONS, "--seeds", "1")
    assert math.isfinite(figures["forms"][REGIONS]["mean"]["rmse_80"])
    assert figures["forms"][REGIONS]["against"] == EMBEDDING
    assert figures["forms"][REGIONS]["relative"]["mae_80"] == {"mean": None, "spread": None}


def test_changes_are_means_over_common_seeds() -> None:
    errors = {NONE: {0: {"mae_80": 2.0}, 1: {"mae_80": 4.0}}, "BF": {1: {"mae_80": 3.0}, 0: {"mae_80": 2.0}, 2: {}}}
    mean, spread = relative(errors, "BF", "mae_80")
    assert mean == pytest.approx((-0.25 + 0.0) / 2)
    assert spread == pytest.approx(np.std([-0.25, 0.0], ddof=1))
    assert all(map(math.isnan, relative({"BF": {0: {"mae_80": 2.0}}}, "BF", "mae_80")))


@pytest.mark.exhaustive
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
