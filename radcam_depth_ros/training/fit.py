"""One loop for every network: batches, losses, optimiser, averaged weights, validation, checkpoints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import torch
from torch import nn

from radcam_depth_ros import configuration, networks
from radcam_depth_ros.networks import archive
from radcam_depth_ros.training.batches import Batch, BatchMaker, SampleSet, prefetch
from radcam_depth_ros.training.checkpoint import AveragedWeights, RunState, load_checkpoint, save_checkpoint
from radcam_depth_ros.training.curves import MetricsLog, draw_curves, read_metrics
from radcam_depth_ros.training.losses import total_loss
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.recipe import OptimiserConfig, StageConfig, TrainingConfig
from radcam_depth_ros.training.samples import TrainingError
from radcam_depth_ros.training.validation import ValidationResult, validate

CHECKPOINT = "last.pt"
METRICS = "metrics.jsonl"
CURVES = "curves.png"
RUN_FILE = "run.yaml"
SKIPS_ALLOWED = 10
"""Iterations in a row without a finite gradient, after which a run is given up."""


@dataclass(frozen=True)
class TrainingData:
    """What is trained and judged on.

    Attributes:
        train: Samples to train on.
        validation: Held-out samples.
        description: What the archive's card says of the data.
    """

    train: SampleSet
    validation: SampleSet
    description: str


@dataclass(frozen=True)
class Limits:
    """When a run ends besides its recipe's iterations.

    Attributes:
        minutes: Of training, over all resumptions; None for no limit.
        should_stop: Asked before each iteration; True ends the run with a checkpoint.
    """

    minutes: float | None = None
    should_stop: Callable[[], bool] = lambda: False


@dataclass(frozen=True)
class StepReport:
    """What an observer is told after each iteration.

    Attributes:
        step: Iterations done.
        progress: Share of the run that is done, 0 to 1.
        loss: Mean of the total loss over the last iterations.
        iterations_per_second: Over the last iterations.
        best_score: Lowest validation MAE at 80 m so far, metres.
    """

    step: int
    progress: float
    loss: float
    iterations_per_second: float
    best_score: float


class Observer(Protocol):
    """Follows a run: a progress bar, or nothing."""

    def on_step(self, report: StepReport) -> None:
        """After each iteration."""

    def on_validation(self, step: int, result: ValidationResult, is_best: bool) -> None:
        """After each validation."""


@dataclass(frozen=True)
class FitResult:
    """How a run ended.

    Attributes:
        archive: The best weights with their card; None when the run was stopped before any validation.
        state: Where it stands.
        finished: Whether the recipe or the time limit was reached, rather than stopped from outside.
    """

    archive: Path | None
    state: RunState
    finished: bool


class Trainer:
    """A run in a folder.

    Args:
        network: Name of the network.
        data: What it is trained and judged on.
        config: The recipe.
        folder: Of the run; holds checkpoint, archive, metrics and curves.
        observer: Told of each step.
        resume: Go on from the folder's checkpoint.
        initial: Weights to start from, an archive of the same architecture; else they are random.

    Raises:
        TrainingError: when checkpoint, initial weights or parts do not fit, or the device is missing.
    """

    def __init__(
        self,
        network: str,
        data: TrainingData,
        config: TrainingConfig,
        folder: Path,
        observer: Observer,
        resume: bool,
        initial: str | Path | None = None,
    ) -> None:
        self._name = network
        self._data = data
        self._config = config
        self._folder = folder
        self._observer = observer
        self._precision = Precision.choose(config.precision, config.device)
        torch.manual_seed(config.seed)
        self.network = networks.create(network, config.architecture)
        _check_parts(self.network, network, config)
        if initial is not None and not resume:
            _initialise(self.network, network, initial)
        self.network.to(self._precision.device)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's annotation lacks it
        self._averaged = AveragedWeights(self.network, config.optimiser.average_decay)
        self._optimiser = _optimiser(self.network, config.optimiser)
        self.state = RunState(samples=len(data.train))
        if resume:
            self.state = load_checkpoint(folder / CHECKPOINT, self.network, self._averaged, self._optimiser)
            if self.state.samples != len(data.train):
                raise TrainingError(
                    f"the run in {folder} was trained on {self.state.samples} samples, and now there are "
                    f"{len(data.train)}; give the same bags, or start another run"
                )
        self._log = MetricsLog(folder / METRICS, self.state.step if resume else None)
        self._maker = BatchMaker(data.train, config.augmentation, config.seed)
        self._validation = [data.validation[index] for index in data.validation.spread(config.validation.frames)]
        self._saved_at = time.monotonic()
        self._counted_until = self._saved_at
        self._speed = 0.0
        self._skipped = 0

    def run(self, limits: Limits) -> FitResult:
        """Trains until the recipe's iterations or the time limit are reached, or somebody stops it.

        Raises:
            TrainingError: when the loss is not a number, or the disk is full; the last checkpoint is intact.
        """
        finished = False
        self._counted_until = time.monotonic()
        with ThreadPoolExecutor(self._config.loader_threads, "batches") as pool:
            while not finished and not limits.should_stop():
                stage = self._config.stage(self._progress(limits))
                finished = self._run_stage(stage, limits, pool)
        if finished and self.state.best_step != self.state.step:
            self._validate()
        self.save()
        best = self.archive_path if self.archive_path.is_file() else None
        return FitResult(best, self.state, finished)

    @property
    def archive_path(self) -> Path:
        """Where the best weights are."""
        return self._folder / f"{self._name}.safetensors"

    def save(self) -> None:
        """Writes the checkpoint and the curves."""
        save_checkpoint(self._folder / CHECKPOINT, self.state, self.network, self._averaged, self._optimiser)
        draw_curves(read_metrics(self._folder / METRICS), self._folder / CURVES, f"{self._name}: {self._folder.name}")
        self._saved_at = time.monotonic()

    def _run_stage(self, stage: StageConfig, limits: Limits, pool: ThreadPoolExecutor) -> bool:
        """Iterates until the stage ends; whether the run is finished."""
        tallest, widest = self._data.train.largest
        size = (min(stage.height, tallest), min(stage.width, widest))
        ahead = self._config.loader_threads + 2
        batches = prefetch(self._maker, self.state.position, stage.batch, size, pool, ahead)
        with closing(batches):
            while not limits.should_stop():
                self._count_time()
                progress = self._progress(limits)
                if progress >= 1:
                    return True
                if self._config.stage(progress) is not stage:
                    return False
                started = time.monotonic()
                losses = self._iterate(next(batches), progress, stage)
                self.state.step += 1
                self.state.position += stage.batch
                self.state.recent.add(losses)
                seconds = time.monotonic() - started
                self._speed = seconds if self._speed == 0 else 0.95 * self._speed + 0.05 * seconds
                self._after_step(limits)
        return False

    def _iterate(self, batch: Batch, progress: float, stage: StageConfig) -> dict[str, float]:
        rate = self._config.optimiser.rate(self.state.step, progress)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        batch = batch.to(self._precision.device)
        self._choose_parts(stage)
        with self._precision.autocast():
            outputs = self.network.train_outputs(batch.image, batch.radar, batch.valid, batch.ground)
        losses = total_loss(
            outputs,
            batch.depth_accumulated_m,
            batch.depth_single_m,
            batch.classes,
            self.network.config.max_depth_m,
            self._config.loss,
        )
        self._optimiser.zero_grad(set_to_none=True)
        losses.total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self._config.optimiser.clip_norm or math.inf)
        if not torch.isfinite(norm):
            self._skip(float(losses.total.detach()))
            return {}
        self._skipped = 0
        self._optimiser.step()
        self._averaged.update(self.network, self.state.step)
        return {**losses.values(), "gradient_norm": float(norm)}

    def _choose_parts(self, stage: StageConfig) -> None:
        """Lets the stage's parts learn; the others keep their weights and statistics."""
        learning = stage.parts or self.network.parts
        self.network.train()
        for name, part in self.network.named_children():
            if name in self.network.parts:
                part.train(name in learning).requires_grad_(name in learning)

    def _skip(self, loss: float) -> None:
        """Leaves the weights as they are after a gradient that is no number: one odd batch does not end a run."""
        self._skipped += 1
        if self._skipped >= SKIPS_ALLOWED:
            raise TrainingError(
                f"the gradient was not finite in {self._skipped} iterations in a row, the last with a loss of {loss}; "
                f"{self._folder / CHECKPOINT} is from before: resume with precision: float32 in {RUN_FILE}, or start "
                "a run with a lower learning rate"
            )

    def _after_step(self, limits: Limits) -> None:
        step, config = self.state.step, self._config
        progress = self._progress(limits)
        losses = self.state.recent.means()
        self._observer.on_step(
            StepReport(step, progress, losses.get("total", math.nan), 1 / self._speed, self.state.best_score)
        )
        if step % config.log_every_iterations == 0:
            rate = config.optimiser.rate(step, progress)
            minutes = self.state.elapsed_s / 60
            self._log.add("train", step, {**losses, "learning_rate": rate, "minutes": minutes})
            self.state.recent.clear()
        if step % config.validation.every_iterations == 0:
            self._validate()
            self.save()
        elif time.monotonic() - self._saved_at > 60 * config.checkpoint_every_minutes:
            self.save()

    def _validate(self) -> None:
        result = validate(self._averaged.network, self._validation, self._precision)
        is_best = result.mae_80_m < self.state.best_score
        if is_best:
            self.state.best_score, self.state.best_step = result.mae_80_m, self.state.step
            archive.save(self._averaged.network, self._card(result), self.archive_path)
        self._log.add("validation", self.state.step, asdict(result))
        self._observer.on_validation(self.state.step, result, is_best)

    def _card(self, result: ValidationResult) -> archive.Card:
        length = f"{self.state.step} iterations, {self.state.position} samples"
        metrics = {
            f"validation_{name}": round(value, 4) for name, value in asdict(result).items() if math.isfinite(value)
        }
        return archive.Card.of(self.network, self._name, f"{self._data.description}; {length}", metrics)

    def _count_time(self) -> None:
        now = time.monotonic()
        self.state.elapsed_s += now - self._counted_until
        self._counted_until = now

    def _progress(self, limits: Limits) -> float:
        progress = self.state.step / self._config.iterations
        if limits.minutes is not None:
            progress = max(progress, self.state.elapsed_s / (60 * limits.minutes))
        return min(progress, 1.0)


def _check_parts(network: networks.Network, name: str, config: TrainingConfig) -> None:
    for stage in config.stages:
        unknown = sorted(set(stage.parts) - set(network.parts))
        if unknown:
            raise TrainingError(
                f"a stage of the recipe trains {unknown[0]!r}, which is no part of {name}; its parts are "
                f"{', '.join(network.parts) or 'not trained one by one'}"
            )


def _initialise(network: networks.Network, name: str, initial: str | Path) -> None:
    given = archive.load(initial)
    if isinstance(given.network, torch.jit.ScriptModule):
        raise TrainingError(f"{initial} is an export, and an export cannot be trained; give the .safetensors file")
    if given.card.network != name:
        raise TrainingError(f"the weights of {initial} are of {given.card.network!r}, not of {name!r}")
    # tau is no weight: it may be another one.
    mine = {**configuration.as_mapping(network.config), "threshold": None}
    theirs = {**given.card.architecture, "threshold": None}
    differing = [key for key in mine if theirs.get(key) != mine[key]]
    if differing:
        raise TrainingError(
            f"the architecture of {initial} differs in {', '.join(differing)}; give the recipe the same architecture"
        )
    network.load_state_dict(given.network.state_dict())


def _optimiser(network: nn.Module, config: OptimiserConfig) -> torch.optim.AdamW:
    parameters = list(network.parameters())
    # Decay would draw norms, biases and attention's alpha and beta to 0, which regularises nothing.
    groups = [
        {"params": [p for p in parameters if p.ndim >= 2], "weight_decay": config.weight_decay},
        {"params": [p for p in parameters if p.ndim < 2], "weight_decay": 0.0},
    ]
    return torch.optim.AdamW(groups, lr=config.learning_rate)
