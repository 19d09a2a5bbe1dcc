from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from radcam_depth_ros.cli import app
from radcam_depth_ros.drive import Sample
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training import drives
from radcam_depth_ros.training.data import cache, rehearsal
from radcam_depth_ros.training.fit import Trainer
from radcam_depth_ros.training.plan import RunPlan
from radcam_depth_ros.training.recipe import FINE_TUNING, recipe_of

RECIPE = {
    "iterations": 2,
    "phases": [{"share": 1.0, "crops": [[64, 64]], "batch": 2}],
    "validation": {"frames": 1},
}


@pytest.fixture
def recipe(tmp_path: Path) -> Path:
    path = tmp_path / "recipe.yaml"
    path.write_text(yaml.safe_dump(RECIPE))
    return path


def invoke(*arguments: object) -> str:
    """What `radcam-depth train` prints; what it raises is raised."""
    words = ["train", *(str(argument) for argument in arguments)]
    return CliRunner().invoke(app, words, catch_exceptions=False).output


@pytest.mark.usefixtures("number_format")
def test_a_network_is_trained_and_trained_on(
    tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]]
) -> None:
    make_bags(2)
    run = tmp_path / "run"
    output = invoke("--bags", tmp_path / "bags", "--out", run, "--config", recipe, "--processes", 1)
    assert "training baff on 6 frames of 1 bags (bags); validating on 6" in output
    card = archive.load(run / "baff.safetensors").card
    assert "2 iterations" in card.training_data
    assert "validation_mae_80_m" in card.metrics
    invoke("--out", run, "--resume", "--iterations", 3)
    assert yaml.safe_load((run / "run.yaml").read_text())["config"]["iterations"] == 3
    with pytest.raises(RadcamDepthError, match="already holds a run"):
        invoke("--bags", tmp_path / "bags", "--out", run)
    with pytest.raises(RadcamDepthError, match="takes bags, recipe, weights and seed from the run"):
        invoke("--bags", tmp_path / "bags", "--out", run, "--resume")


def test_a_run_starts_from_weights(tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]]) -> None:
    make_bags(2)
    arguments = ("--bags", tmp_path / "bags", "--config", recipe, "--processes", 1)
    invoke(*arguments, "--out", tmp_path / "run", "--init", "baff")
    start, card = (archive.load(source).card for source in ("baff", tmp_path / "run" / "baff.safetensors"))
    known = {"calibration": [1.0, 0.0], **start.architecture}
    assert {**card.architecture, "calibration": known["calibration"]} == known
    with pytest.raises(RadcamDepthError, match="no weight file at weights"):
        invoke(*arguments, "--out", tmp_path / "other", "--init", "weights")
    assert not (tmp_path / "other").exists()


@pytest.mark.usefixtures("number_format")
def test_weights_are_tuned_and_rehearse(tmp_path: Path, make_bags: Callable[[int], list[Path]]) -> None:
    first, *known = make_bags(3)
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(yaml.safe_dump({**RECIPE, "rehearsal": {"share": 0.5}, "initial_share": 0.25}))
    arguments = ("--bags", first, "--init", "baff", "--config", recipe, "--processes", 1)
    run = tmp_path / "run"
    output = invoke(*arguments, *(word for bag in known for word in ("--rehearsal-bags", bag)), "--out", run)
    assert "from the weights of baff, rehearsing 6 frames as 50 % of all" in " ".join(output.split())
    # Judged before the first iteration and after the last, on both kinds of frames.
    assert " ".join(output.split()).count("rehearsed: dense MAE") == 2
    assert "rehearsal_mae_80_m" in archive.load(run / "baff.safetensors").card.metrics
    with pytest.raises(RadcamDepthError, match="rehearsal-bags need a share"):
        invoke("--bags", first, "--rehearsal-bags", known[0], "--out", tmp_path / "other")


def test_weights_alone_bring_the_recipe_of_fine_tuning(
    tmp_path: Path,
    make_bags: Callable[[int], list[Path]],
    frames: Callable[[int, int], Iterator[Sample]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rehearsal, "_simulate", lambda mapping, seed, frames, out: out.write_bytes(b"made up"))
    monkeypatch.setattr(cache, "read_samples", lambda path, *settings: frames(1, 2))
    run, bags = tmp_path / "run", make_bags(1)
    invoke("--bags", *bags, "--init", "baff", "--out", run, "--processes", 1, "--iterations", 1)
    assert RunPlan.read(run).config.rehearsal.share == recipe_of(FINE_TUNING).rehearsal.share
    assert len(list((run / "cache" / "rehearsal").rglob("seed_*.mcap"))) == recipe_of(FINE_TUNING).rehearsal.drives


def test_a_run_that_was_cut_off_before_its_first_checkpoint_begins_again(
    tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]]
) -> None:
    run = tmp_path / "run"
    invoke("--bags", *make_bags(2), "--out", run, "--config", recipe, "--processes", 1)
    for checkpoint in run.glob("last*"):
        checkpoint.unlink()
    assert "2 iterations" in archive.load(run / "baff.safetensors").card.training_data
    invoke("--out", run, "--resume")
    assert (run / "last.pt").is_file()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_run_with_a_checkpoint(
    number: signal.Signals,
    tmp_path: Path,
    recipe: Path,
    make_bags: Callable[[int], list[Path]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    iterate = Trainer._iterate

    def iterate_and_raise(*arguments: Any) -> dict[str, float]:
        signal.raise_signal(number)
        return iterate(*arguments)

    monkeypatch.setattr(Trainer, "_iterate", iterate_and_raise)
    run = tmp_path / "run"
    words = ["train", "--bags", str(make_bags(2)[0].parent), "--out", str(run), "--config", str(recipe)]
    result = CliRunner().invoke(app, [*words, "--processes", "1"])
    assert result.exit_code == 130
    assert "stopped at iteration 1; go on with: radcam-depth train --out" in " ".join(result.output.split())
    assert (run / "last.pt").is_file()


def test_bags_may_follow_one_option(tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]]) -> None:
    bags = make_bags(3)
    with pytest.raises(RadcamDepthError, match="unknown network"):
        invoke("--bags", *bags, "--out", tmp_path / "run", "--network", "foundation")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--bags", "missing"], "no bag at missing"),
        ([], "give the bags to train on"),
        (["--resume"], "holds no run to resume"),
    ],
)
def test_mistakes_are_told(arguments: list[str], message: str, tmp_path: Path) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        invoke("--out", tmp_path / "run", *arguments)
    assert not (tmp_path / "run").exists()


def test_bags_that_come_while_a_network_trains_are_taken(
    tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]], monkeypatch: pytest.MonkeyPatch
) -> None:
    held_out, *_ = make_bags(2)
    held_out = held_out.rename(tmp_path / "3.mcap")
    monkeypatch.setattr(drives, "LOOK_EVERY_S", 0.01)
    text = {**RECIPE, "iterations": 10**6, "minutes": 1.0, "log_every_iterations": 1}
    recipe.write_text(yaml.safe_dump({**text, "checkpoint_every_minutes": 60.0}))
    grow, counts = Trainer._grow, list[int]()

    def watched(trainer: Trainer) -> None:
        if not counts:
            (tmp_path / "bags" / "5.mcap").write_bytes(b"made up")
        grow(trainer)
        counts.append(trainer.state.samples)
        if trainer.state.samples == 12 or len(counts) > 1000:
            trainer.state.elapsed_s = 3600.0

    monkeypatch.setattr(Trainer, "_grow", watched)
    words = ("--bags", tmp_path / "bags", "--out", tmp_path / "run", "--config", recipe, "--processes", 1)
    with pytest.raises(RadcamDepthError, match="--growing needs bags that are always held out: give them by --valid"):
        invoke(*words, "--growing")
    invoke(*words, "--validation-bags", held_out, "--growing")
    assert counts[-1] == 12
    assert "12 frames of 2 bags" in archive.load(tmp_path / "run" / "baff.safetensors").card.training_data
    assert RunPlan.read(tmp_path / "run").growing == (str(tmp_path / "bags"),)
    # All that have come are there when it goes on.
    output = invoke("--out", tmp_path / "run", "--resume", "--iterations", counts[-1])
    assert "training baff on 12 frames of 2 bags" in output
    with pytest.raises(RadcamDepthError, match="--seed and --growing out"):
        invoke("--out", tmp_path / "run", "--resume", "--growing")


def test_a_drive_for_measuring_is_refused(tmp_path: Path, recipe: Path, make_bags: Callable[[int], list[Path]]) -> None:
    drive = make_bags(1)[0].rename(tmp_path / "seed_1000003.mcap")
    with pytest.raises(RadcamDepthError, match="kept for measuring"):
        invoke("--bags", drive, "--out", tmp_path / "run", "--config", recipe)


def test_a_recipe_with_a_mistake_is_told(tmp_path: Path, make_bags: Callable[[int], list[Path]]) -> None:
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("optimizer: {learning_rate: 1.0e-3}")
    with pytest.raises(RadcamDepthError, match="did you mean optimiser"):
        invoke("--bags", make_bags(1)[0], "--out", tmp_path / "run", "--config", recipe)
