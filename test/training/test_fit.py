from __future__ import annotations

import dataclasses
import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from small_training import CONFIG, RECIPE, Grown, Miniature, Watch, data_of
from torch import Tensor

from radcam_depth_ros.networks import TrainOutputs, registry
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.training import fit
from radcam_depth_ros.training.curves import read_metrics
from radcam_depth_ros.training.data.sample_sets import TrainingData
from radcam_depth_ros.training.data.samples import CachedDrive, TrainingSample
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.fit import FitResult, Trainer
from radcam_depth_ros.training.initial import Sources
from radcam_depth_ros.training.recipe import PhaseConfig, TrainingConfig
from radcam_depth_ros.training.validation import LogitCounts, ValidationResult


@pytest.fixture(autouse=True)
def _with_miniature(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry._NETWORKS, "miniature", Miniature)


@pytest.fixture
def data(drive: CachedDrive) -> TrainingData:
    return data_of(drive)


def run(
    data: TrainingData,
    folder: Path,
    config: TrainingConfig = CONFIG,
    resume: bool = False,
    stop_after: int = 10**9,
    network: str = "miniature",
    initial: Path | None = None,
) -> tuple[FitResult, Trainer, Watch]:
    folder.mkdir(exist_ok=True)
    watch = Watch()
    sources = Sources(initial=None if initial is None else str(initial))
    trainer = Trainer(network, data, config, folder, watch, resume, sources)
    result = trainer.run(lambda: trainer.state.step >= stop_after)
    return result, trainer, watch


def metrics(folder: Path) -> list[dict[str, object]]:
    lines = read_metrics(folder / "metrics.jsonl")
    return [{name: value for name, value in line.items() if name != "minutes"} for line in lines]


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_resumed_run_equals_an_uninterrupted_one(precision: str, tmp_path: Path, data: TrainingData) -> None:
    config = dataclasses.replace(CONFIG, precision=precision)
    whole, expected, watch = run(data, tmp_path / "whole", config)
    assert whole.finished
    assert watch.validations == [4, 6]
    stopped, _, _ = run(data, tmp_path / "parts", config, stop_after=3)
    assert not stopped.finished
    resumed, trainer, _ = run(data, tmp_path / "parts", config, resume=True)
    assert resumed.finished
    for name, value in expected.network.state_dict().items():
        assert torch.equal(value, trainer.network.state_dict()[name]), name
    assert metrics(tmp_path / "parts") == metrics(tmp_path / "whole")
    whole_card, card = (archive.load(result.archive or "").card for result in (whole, resumed))
    assert card == whole_card


def test_samples_may_be_held_and_augmented_on_the_device(tmp_path: Path, data: TrainingData) -> None:
    config = dataclasses.replace(CONFIG, samples="device")
    _, expected, _ = run(data, tmp_path / "whole", config)
    run(data, tmp_path / "parts", config, stop_after=3)
    _, trainer, _ = run(data, tmp_path / "parts", config, resume=True)
    for name, value in expected.network.state_dict().items():
        torch.testing.assert_close(value, trainer.network.state_dict()[name], msg=name)
    with pytest.raises(TrainingError, match="samples must be 'disk' or 'device', got 'gpu'"):
        dataclasses.replace(CONFIG, samples="gpu")


@pytest.mark.parametrize("samples", ["disk", "device"])
def test_drives_that_come_while_a_network_trains_are_learned_from(
    samples: str, tmp_path: Path, data: TrainingData, drive: CachedDrive
) -> None:
    config = dataclasses.replace(CONFIG, iterations=12, samples=samples)
    (tmp_path / "run").mkdir()
    growth: Any = Grown(drive.folder, drive.folder)
    trainer = Trainer("miniature", data, config, tmp_path / "run", Watch(), resume=False, growth=growth)
    result = trainer.run()
    before = len(data.train)
    assert trainer.state.samples == before + 12
    assert f"{before + 12} frames of 3 bags" in archive.load(result.archive or "").card.training_data
    # What has come is there when a run goes on; without growth, other data are refused.
    grown = replace(data, train=data.train.grown([drive]))
    longer = dataclasses.replace(config, iterations=14)
    Trainer("miniature", grown, longer, tmp_path / "run", Watch(), resume=True, growth=growth).run()
    with pytest.raises(TrainingError, match="was trained on"):
        Trainer("miniature", data, longer, tmp_path / "run", Watch(), resume=True)


def test_drives_that_do_not_fit_on_the_device_are_left_out(
    tmp_path: Path, data: TrainingData, drive: CachedDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    growth: Any = Grown(drive.folder)
    watch = Watch()
    config = dataclasses.replace(CONFIG, samples="device")
    trainer = Trainer("miniature", data, config, tmp_path / "run", watch, resume=False, growth=growth)

    def refuse(samples: object, place: int) -> None:
        raise TrainingError("they take more than there is")

    monkeypatch.setattr(trainer._maker, "grow", refuse)
    assert trainer.run().finished
    assert trainer.state.samples == len(data.train)
    assert watch.notes == ["no more drives are taken: they take more than there is"]


@pytest.mark.usefixtures("number_format")
def test_a_run_writes_weights_metrics_and_curves(tmp_path: Path, data: TrainingData) -> None:
    result, _, watch = run(data, tmp_path / "run")
    assert result.archive == tmp_path / "run" / "miniature.safetensors"
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "last.before.pt",
        "last.pt",
        "metrics.jsonl",
        "miniature.safetensors",
        "miniature.yaml",
        "report.html",
    ]
    lines = metrics(tmp_path / "run")
    assert [line["step"] for line in lines] == [2, 4, 4, 6, 6]
    assert [report.step for report in watch.steps] == [1, 2, 3, 4, 5, 6]
    assert watch.steps[-1].progress == 1
    assert "six made-up frames" in archive.load(result.archive).card.training_data


def test_a_few_samples_are_learned_by_heart(tmp_path: Path, data: TrainingData) -> None:
    plain = replace(RECIPE.augmentation, mirror=0.0)
    config = replace(
        RECIPE,
        iterations=60,
        log_every_iterations=5,
        phases=(PhaseConfig(1.0, ((64, 128),), 2),),
        optimiser=replace(RECIPE.optimiser, learning_rate=1e-2, warm_up_iterations=3, average_decay=0.5),
        augmentation=plain,
        validation=replace(RECIPE.validation, every_iterations=100, frames=1),
    )
    run(data, tmp_path / "run", config)
    losses = [float(str(line["total"])) for line in metrics(tmp_path / "run") if line["kind"] == "train"]
    assert losses[-1] < 0.7 * losses[0]


@pytest.mark.usefixtures("number_format")
def test_baff_is_trained_and_saved(tmp_path: Path, data: TrainingData) -> None:
    config = dataclasses.replace(CONFIG, iterations=2, phases=(PhaseConfig(1.0, ((64, 64),), 2),))
    result, trainer, _ = run(data, tmp_path / "run", config, network="baff")
    assert result.finished
    assert archive.load(result.archive or "").card.network == "baff"
    assert all(torch.isfinite(value).all() for value in trainer.network.state_dict().values())


@pytest.mark.usefixtures("number_format")
def test_parts_learn_one_after_the_other(tmp_path: Path, data: TrainingData) -> None:
    phases = (PhaseConfig(0.5, ((64, 64),), 1, ("association",)), PhaseConfig(0.5, ((64, 64),), 1, ("fusion",)))
    config = dataclasses.replace(CONFIG, iterations=2, phases=phases)
    states: list[dict[str, Tensor]] = []
    for steps in (0, 1, 2):
        _, trainer, _ = run(data, tmp_path / "run", config, steps > 0, stop_after=steps, network="baff")
        states.append({name: value.clone() for name, value in trainer.network.state_dict().items()})
    for before, after, learning in ((states[0], states[1], "association"), (states[1], states[2], "fusion")):
        changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
        assert changed == {learning}


@pytest.mark.parametrize("part", ["road", "doubt", "sky", "mix"])
def test_a_part_may_learn_alone(tmp_path: Path, data: TrainingData, part: str) -> None:
    config = dataclasses.replace(CONFIG, iterations=1, phases=(PhaseConfig(1.0, ((64, 64),), 1, (part,)),))
    states: list[dict[str, Tensor]] = []
    for steps in (0, 1):
        _, trainer, _ = run(data, tmp_path / "run", config, steps > 0, stop_after=steps, network="baff")
        states.append({name: value.clone() for name, value in trainer.network.state_dict().items()})
    learned = dict(trainer.network.named_parameters()).keys()
    assert {name.split(".")[0] for name in learned if not torch.equal(states[0][name], states[1][name])} == {part}


@pytest.mark.usefixtures("number_format")
def test_parts_learn_at_their_own_rates(tmp_path: Path, data: TrainingData) -> None:
    changes: list[float] = []
    for factor in (0.0, 0.1, 1.0):
        optimiser = dataclasses.replace(CONFIG.optimiser, part_rates={"association": factor})
        config = dataclasses.replace(
            CONFIG, iterations=1, phases=(PhaseConfig(1.0, ((64, 64),), 2),), optimiser=optimiser
        )
        states: list[Tensor] = []
        for steps in (0, 1):
            _, trainer, _ = run(data, tmp_path / str(factor), config, steps > 0, stop_after=steps, network="baff")
            weights = trainer.network.get_submodule("association").parameters()
            states.append(torch.cat([weight.detach().flatten().clone() for weight in weights]))
        changes.append(float((states[1] - states[0]).norm()))
    assert changes[0] == 0
    assert changes[1] == pytest.approx(0.1 * changes[2], rel=1e-3)


@pytest.mark.parametrize(
    "given",
    [
        {"phases": (PhaseConfig(1.0, ((64, 64),), 1, ("fusing",)),)},
        {"optimiser": dataclasses.replace(CONFIG.optimiser, part_rates={"fusing": 0.1})},
    ],
)
def test_a_part_that_a_network_does_not_have_is_refused(
    tmp_path: Path, data: TrainingData, given: dict[str, Any]
) -> None:
    config = dataclasses.replace(CONFIG, **given)
    with pytest.raises(
        TrainingError,
        match=r"names 'fusing', which is no part of baff; its parts are context, encoder, association, road, doubt, ",
    ):
        run(data, tmp_path / "run", config, network="baff")


def test_a_run_starts_from_weights_that_are_given(tmp_path: Path, data: TrainingData) -> None:
    first, _, _ = run(data, tmp_path / "first")
    assert first.archive is not None
    given = archive.load(first.archive).network.state_dict()
    _, trainer, _ = run(data, tmp_path / "second", initial=first.archive, stop_after=0)
    assert all(torch.equal(value, given[name]) for name, value in trainer.network.state_dict().items())


def test_weights_of_another_architecture_are_no_start(tmp_path: Path, data: TrainingData) -> None:
    first, _, _ = run(data, tmp_path / "first")
    other = dataclasses.replace(CONFIG, architecture={"max_depth_m": 80.0})
    with pytest.raises(TrainingError, match=r"its max_depth_m is 100.0, the recipe.s is 80.0"):
        run(data, tmp_path / "second", other, initial=first.archive)
    with pytest.raises(TrainingError, match="are of 'miniature'"):
        run(data, tmp_path / "third", network="baff", initial=first.archive)
    export = tmp_path / "export.pt"
    torchscript.export(archive.load("baff"), export)
    with pytest.raises(TrainingError, match=r"an export cannot be trained; give the \.safetensors file"):
        run(data, tmp_path / "fourth", network="baff", initial=export)


def test_a_time_limit_ends_a_run(tmp_path: Path, data: TrainingData) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    config = dataclasses.replace(CONFIG, iterations=10**6, minutes=0.01)
    trainer = Trainer("miniature", data, config, folder, Watch(), False)
    result = trainer.run()
    assert result.finished
    assert 0 < result.state.step < 10**6


def test_lines_of_a_run_that_was_cut_off_are_dropped(tmp_path: Path, data: TrainingData) -> None:
    run(data, tmp_path / "run", stop_after=3)
    with (tmp_path / "run" / "metrics.jsonl").open("a") as file:
        file.write(json.dumps({"kind": "train", "step": 5}) + '\n{"kind": "tr')
    run(data, tmp_path / "run", resume=True, stop_after=4)
    assert [line["step"] for line in metrics(tmp_path / "run")] == [2, 4, 4]


def test_gradients_that_are_not_finite_end_a_run(tmp_path: Path, data: TrainingData) -> None:
    # Infinite weights of a loss stand for whatever makes a gradient infinite.
    config = dataclasses.replace(CONFIG, iterations=100, loss={"accumulated": math.inf})
    with pytest.raises(TrainingError, match=r"not finite in 10 iterations.*learning rate"):
        run(data, tmp_path / "run", config)


def test_odd_batches_are_skipped_and_told(tmp_path: Path, data: TrainingData, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Miniature.train_outputs
    calls = 0

    def train_outputs(network: Miniature, *inputs: Tensor) -> TrainOutputs:
        nonlocal calls
        outputs = honest(network, *inputs)
        calls += network.training
        return outputs._replace(confidence_logit=outputs.confidence_logit * (math.nan if calls in (2, 3) else 1))

    monkeypatch.setattr(Miniature, "train_outputs", train_outputs)
    result, trainer, watch = run(data, tmp_path / "run")
    assert result.finished
    assert watch.notes == [
        f"iteration {step} is skipped: its gradient is not finite, with a loss of nan" for step in (2, 3)
    ]
    assert all(torch.isfinite(value).all() for value in trainer.network.parameters())


def test_a_run_ends_when_nothing_gets_better(tmp_path: Path, data: TrainingData) -> None:
    config = dataclasses.replace(
        CONFIG,
        iterations=100,
        # Weights that move nowhere.
        optimiser=replace(RECIPE.optimiser, learning_rate=1e-12, average_decay=0.0),
        freeze_statistics=True,
        validation=replace(RECIPE.validation, every_iterations=2, frames=1, patience=2),
    )
    result, _, watch = run(data, tmp_path / "run", config)
    assert result.finished
    assert watch.validations == [2, 4, 6]
    assert result.state.best_step == 2
    again, _, watch = run(data, tmp_path / "run", config, resume=True)
    assert again.finished
    assert watch.steps == watch.validations == []


def test_saved_weights_have_a_calibrated_confidence(tmp_path: Path, data: TrainingData) -> None:
    result, trainer, _ = run(data, tmp_path)
    card = archive.load(result.archive or "").card
    assert trainer.network.config.calibration == (1.0, 0.0)
    assert card.architecture["calibration"] != [1.0, 0.0]


def test_rehearsed_frames_have_as_much_of_a_say_in_the_calibration_as_new_ones(
    tmp_path: Path, data: TrainingData, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = [LogitCounts.none(), LogitCounts.none()]
    seen: list[Any] = []
    answers = itertools.cycle([ValidationResult(*[1.0] * 7)])
    pairs = itertools.cycle(counts)
    monkeypatch.setattr(fit, "validate", lambda *_: (next(answers), next(pairs)))
    monkeypatch.setattr(fit, "platt_scaling", lambda kinds, former: seen.append(kinds) or (2.0, 0.5))
    data = dataclasses.replace(data, rehearsal=data.train, rehearsal_validation=data.validation)
    config = dataclasses.replace(CONFIG, rehearsal=replace(RECIPE.rehearsal, share=0.5))
    result, _, _ = run(data, tmp_path, config)
    assert all(kinds[0] is counts[0] and kinds[1] is counts[1] for kinds in seen)
    assert archive.load(result.archive or "").card.architecture["calibration"] == [2.0, 0.5]


def test_weights_that_have_forgotten_too_much_are_not_kept(
    tmp_path: Path, data: TrainingData, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _, _ = run(data, tmp_path / "first")
    # Errors on new and on rehearsed drives: at first; better, but too much forgotten; good; worse.
    errors = iter([3.0, 2.0, 1.0, 2.4, 1.5, 2.2, 1.6, 2.0])

    def _judged(*_: Any) -> tuple[ValidationResult, LogitCounts]:
        return ValidationResult(*[1.0] * 2, next(errors), *[1.0] * 4), LogitCounts.none()

    monkeypatch.setattr(fit, "validate", _judged)
    data = dataclasses.replace(data, rehearsal=data.train, rehearsal_validation=data.validation)
    config = dataclasses.replace(
        CONFIG,
        validation=replace(RECIPE.validation, every_iterations=2),
        rehearsal=replace(RECIPE.rehearsal, share=0.5, tolerance=0.15),
    )
    result, _, _ = run(data, tmp_path / "second", config, initial=first.archive)
    assert (result.state.best_score, result.state.best_step) == (1.5, 4)


def test_shipped_weights_keep_a_share_of_the_initial_ones(tmp_path: Path, data: TrainingData) -> None:
    first, _, _ = run(data, tmp_path / "first")
    assert first.archive is not None
    initial = archive.load(first.archive).network.state_dict()
    config = dataclasses.replace(
        CONFIG, initial_share=0.75, optimiser=replace(RECIPE.optimiser, learning_rate=0.05, average_decay=0.0)
    )
    stopped, _, _ = run(data, tmp_path / "second", config, initial=first.archive, stop_after=3)
    result, trainer, _ = run(data, tmp_path / "second", config, initial=first.archive, resume=True)
    blended = trainer.judged().state_dict()
    for name, value in trainer.network.state_dict().items():
        if value.is_floating_point():
            torch.testing.assert_close(blended[name], 0.75 * initial[name] + 0.25 * value)
    assert not stopped.finished
    assert result.finished


def test_frames_without_ground_truth_cannot_be_validated_on(
    tmp_path: Path, data: TrainingData, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = CachedDrive.__getitem__

    def read_sky(drive: CachedDrive, index: int) -> TrainingSample:
        sample = read(drive, index)
        return dataclasses.replace(sample, depth_m=np.full_like(sample.depth_m, math.inf))

    monkeypatch.setattr(CachedDrive, "__getitem__", read_sky)
    with pytest.raises(TrainingError, match="none of the 1 frames to validate on has ground truth nearer than 80 m"):
        run(data, tmp_path / "run")


def test_a_batch_that_processes_cannot_share_is_refused(tmp_path: Path, data: TrainingData) -> None:
    with pytest.raises(TrainingError, match="a batch of 1 samples cannot be split evenly among 2 processes"):
        Trainer("miniature", data, CONFIG, tmp_path, Watch(), False, ranks=Ranks(0, 2))


def test_resuming_with_other_data_or_nothing_is_refused(tmp_path: Path, data: TrainingData) -> None:
    with pytest.raises(TrainingError, match="no checkpoint"):
        run(data, tmp_path / "none", resume=True)
    run(data, tmp_path / "run", stop_after=1)
    fewer, _ = data.train.split(0.5)
    with pytest.raises(TrainingError, match="trained on 5 samples"):
        run(dataclasses.replace(data, train=fewer), tmp_path / "run", resume=True)
    for checkpoint in (tmp_path / "run").glob("*.pt"):
        checkpoint.write_bytes(b"no checkpoint")
    with pytest.raises(TrainingError, match="cannot be resumed"):
        run(data, tmp_path / "run", resume=True)


def test_a_batch_that_leaves_a_norm_one_value_is_refused(tmp_path: Path, data: TrainingData) -> None:
    config = dataclasses.replace(CONFIG, phases=(PhaseConfig(1.0, ((64, 64),), 1),))
    with pytest.raises(TrainingError, match=r"1 images of 64 x 64 pixels at once .* give larger crops"):
        run(data, tmp_path / "run", config, network="baff")
