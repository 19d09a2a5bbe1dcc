"""The training loop of every network: batches, losses, optimiser, averaged weights, validation, checkpoints."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch.nn.utils import clip_grad_norm_

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.checkpoint import AveragedWeights, RunState, Working, load_checkpoint, save_checkpoint
from radcam_depth_ros.training.curves import MetricsLog, read_metrics
from radcam_depth_ros.training.data.batches import Batch, prefetch
from radcam_depth_ros.training.data.growth import Growth
from radcam_depth_ros.training.data.sample_sets import TrainingData
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.distributed import normalisation
from radcam_depth_ros.training.distributed.gradients import share_gradients
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.initial import Sources, blend, load_backbones, load_initial
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.observer import Observer, StepReport, ValidationReport
from radcam_depth_ros.training.optimiser import optimiser_of
from radcam_depth_ros.training.page import first_middle_last, panels_of, write_page
from radcam_depth_ros.training.precision import Precision
from radcam_depth_ros.training.recipe import PhaseConfig, TrainingConfig
from radcam_depth_ros.training.resident.choice import maker_of
from radcam_depth_ros.training.teacher import Teacher
from radcam_depth_ros.training.validation import ValidationResult, platt_scaling, spread, validate

CHECKPOINT = "last.pt"
METRICS = "metrics.jsonl"
PAGE = "report.html"
SKIPS_ALLOWED = 10
"""Iterations in a row without a finite gradient, after which a run is given up."""


@dataclass(frozen=True)
class FitResult:
    """How a run ended.

    Attributes:
        archive: The best weights with their card; None when the run was stopped before any validation.
        state: Where it stands.
        finished: Whether the recipe, the time limit or the end of all patience was reached, rather than stopped from
            outside.
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
        folder: Of the run; holds checkpoint, archive, metrics and page.
        observer: Told of each step.
        resume: Go on from the folder's checkpoint.
        sources: Weights that it starts or learns from.
        ranks: The processes that train together; the first of them alone writes.
        growth: Finds drives that come while it trains; the first process alone asks it.

    Raises:
        TrainingError: when checkpoint, sources, samples or parts do not fit, or the device is missing.
    """

    def __init__(
        self,
        network: str,
        data: TrainingData,
        config: TrainingConfig,
        folder: Path,
        observer: Observer,
        resume: bool,
        sources: Sources | None = None,
        ranks: Ranks | None = None,
        growth: Growth | None = None,
    ) -> None:
        self._name = network
        self._data = data
        self._config = config
        self._folder = folder
        self._observer = observer
        self._ranks = ranks or Ranks()
        self._growth = growth
        sources = sources or Sources()
        self._precision = Precision.choose(config.precision, config.device)
        if self._ranks.size == 1:
            torch.set_num_threads(min(config.threads, torch.get_num_threads()))
        torch.manual_seed(config.seed)
        self.network = networks.create(network, config.architecture)
        config.require_parts(network, self.network.parts)
        self._criterion = Criterion.of(network, config.loss)
        for phase in config.phases:
            self._ranks.part_of(phase.batch)
        self._validation = spread(data.validation, config.validation.frames)
        self._rehearsal = spread(data.rehearsal_validation, config.validation.frames)
        if sources.initial is not None and not resume:
            load_initial(self.network, network, sources.initial)
        if sources.backbones is not None and not resume:
            load_backbones(self.network, sources.backbones)
        self.network.to(self._precision.device)
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's annotation lacks it
        averaged = AveragedWeights(self.network, config.optimiser.average_decay)
        if self._ranks.size > 1 and config.joint_norms:
            normalisation.join_batch_norms(self.network, self._ranks)
        self._working = Working(self.network, averaged, optimiser_of(self.network, config.optimiser))
        if sources.initial is not None and config.initial_share > 0:
            self._working.initial.update(
                {name: value.clone().cpu() for name, value in self.network.state_dict().items()}
            )
        self.state = RunState(samples=len(data.train))
        if resume:
            self.state = load_checkpoint(folder / CHECKPOINT, self._working, observer.on_note)
            if growth is not None:
                self.state.samples = len(data.train)
            if self.state.samples != len(data.train):
                raise TrainingError(
                    f"the run in {folder} was trained on {self.state.samples} samples, and now there are "
                    f"{len(data.train)}; give the same bags, or start another run"
                )
        self._is_tuned = sources.initial is not None
        self._teacher = None
        if sources.teacher is not None:
            self._teacher = Teacher(sources.teacher, self.network, config.distillation, self._precision)
        if self._ranks.is_first:
            self._log = MetricsLog(folder / METRICS, self.state.step if resume else None, config.tensorboard)
        given = (data.train, config.augmentation, config.seed, data.rehearsal, config.rehearsal.share)
        self._maker = maker_of(config.samples, self._precision.device, *given)
        self._saved_at = self._counted_until = time.monotonic()
        self._speed = 0.0

    def run(self, should_stop: Callable[[], bool] = lambda: False) -> FitResult:
        """Trains until the recipe's iterations or time limit are reached, nothing gets better, or somebody stops it.

        Args:
            should_stop: Asked before each iteration; True ends the run with a checkpoint.

        Raises:
            TrainingError: when the loss is not a number, or the disk is full; the last checkpoint is intact.
        """
        self._counted_until = time.monotonic()
        if self._is_tuned and self.state.validated_step < 0:
            self._validate()
        is_stopped = self._agree(should_stop())
        with ThreadPoolExecutor(self._config.loader_threads, "batches") as pool:
            while not is_stopped and not self._is_finished():
                is_stopped = self._run_phase(self._config.phase(self._progress()), should_stop, pool)
        finished = self._is_finished()
        if finished and self.state.validated_step != self.state.step:
            self._validate()
        self.save()
        best = self.archive_path if self.archive_path.is_file() else None
        return FitResult(best, self.state, finished)

    @property
    def archive_path(self) -> Path:
        """Where the best weights are."""
        return self._folder / f"{self._name}.safetensors"

    def judged(self) -> networks.Network:
        """The network that is validated and shipped: averaged weights, with their share of the initial ones."""
        network: networks.Network = self._working.averaged.network
        if self._working.initial:
            network = copy.deepcopy(network)
            blend(network, self._working.initial, self._config.initial_share)
        return network

    def save(self) -> None:
        """Writes the checkpoint."""
        if self._ranks.is_first:
            save_checkpoint(self._folder / CHECKPOINT, self.state, self._working)
        self._saved_at = time.monotonic()

    def _run_phase(self, phase: PhaseConfig, should_stop: Callable[[], bool], pool: ThreadPoolExecutor) -> bool:
        """Iterates until the phase or the run ends; whether somebody stopped it."""
        tallest, widest = self._data.largest
        sizes = [(min(height, tallest), min(width, widest)) for height, width in phase.crops]
        count = self._ranks.part_of(phase.batch)
        place = self.state.position + self._ranks.rank * count
        with closing(prefetch(self._maker, place, count, sizes, pool, self._ahead, phase.batch)) as batches:
            while not self._agree(should_stop()):
                if self._is_finished() or self._config.phase(self._progress()) is not phase:
                    return False
                started = time.monotonic()
                losses = self._iterate(next(batches), phase)
                self.state.step += 1
                self.state.position += phase.batch
                self.state.recent.add(losses)
                seconds = time.monotonic() - started
                self._speed = seconds if self._speed == 0 else 0.95 * self._speed + 0.05 * seconds
                self._after_step()
        return True

    def _iterate(self, batch: Batch, phase: PhaseConfig) -> dict[str, float]:
        optimiser, config = self._working.optimiser, self._config.optimiser
        rate = config.rate(self.state.step, self._progress())
        for group in optimiser.param_groups:
            group["lr"] = rate * group["factor"]
        batch = batch.to(self._precision.device)
        self._choose_parts(phase)
        with self._precision.autocast():
            outputs = _outputs_of(self.network, batch)
        total, parts = self._criterion(outputs, batch, self.network.config.max_depth_m, self._ranks)
        if self._teacher is not None:
            told, parts_told = self._teacher.loss(outputs, self._name, batch, self._ranks)
            total, parts = total + told, {**parts, **parts_told}
        optimiser.zero_grad(set_to_none=True)
        total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
        share_gradients(self.network, self._ranks)
        norm = clip_grad_norm_(self.network.parameters(), config.clip_norm or math.inf)
        parts = {"total": total.detach(), **parts}
        # Of the whole batch, where several processes share it.
        numbers = self._ranks.add(torch.stack([part.float() for part in parts.values()])).tolist()
        values = dict(zip(parts, numbers, strict=True))
        if not torch.isfinite(norm):
            self._skip(values["total"])
            return {}
        self.state.skipped = 0
        optimiser.step()
        self._working.averaged.update(self.network, self.state.step)
        return {**values, "gradient_norm": float(norm)}

    def _choose_parts(self, phase: PhaseConfig) -> None:
        """Lets the phase's parts learn; the others keep their weights and statistics."""
        learning = phase.parts or self.network.parts
        self.network.train()
        for name, part in self.network.named_children():
            if name in self.network.parts:
                part.train(name in learning).requires_grad_(name in learning)
        if self._config.freeze_statistics:
            normalisation.freeze_statistics(self.network)

    def _skip(self, loss: float) -> None:
        """Leaves the weights as they are after a gradient that is no number: one odd batch does not end a run."""
        self.state.skipped += 1
        if self.state.skipped >= SKIPS_ALLOWED:
            raise TrainingError(
                f"the gradient was not finite in {self.state.skipped} iterations in a row, the last with a loss of "
                f"{loss}; {self._folder / CHECKPOINT} is from before: resume with precision: float32 in run.yaml, or "
                "start a run with a lower learning rate"
            )
        self._observer.on_note(
            f"iteration {self.state.step + 1} is skipped: its gradient is not finite, with a loss of {loss}"
        )

    def _after_step(self) -> None:
        step, config = self.state.step, self._config
        progress = self._progress()
        losses = self.state.recent.means()
        self._observer.on_step(
            StepReport(step, progress, losses.get("total", math.nan), 1 / self._speed, self.state.best_score)
        )
        if step % config.log_every_iterations == 0:
            rate = config.optimiser.rate(step, progress)
            minutes = self.state.elapsed_s / 60
            self._record("train", {**losses, "learning_rate": rate, "minutes": minutes})
            self.state.recent.clear()
            self._grow()
        if step % config.validation.every_iterations == 0:
            self._validate()
            self.save()
        elif time.monotonic() - self._saved_at > 60 * config.checkpoint_every_minutes:
            self.save()

    def _grow(self) -> None:
        """Learns from drives that have come meanwhile, all processes from the same and from the same place on."""
        if self._growth is None:
            return
        folders = self._ranks.of_first(self._growth.take() if self._ranks.is_first else ())
        if not folders:
            return
        train = self._data.train.grown([CachedDrive(folder) for folder in folders])
        # Batches that are in the making know nothing of them.
        ahead = self._ahead + 1
        try:
            self._maker.grow(train, self.state.position + ahead * max(phase.batch for phase in self._config.phases))
        except TrainingError as error:
            self._observer.on_note(f"no more drives are taken: {error}")
            self._growth = None
            return
        self.state.samples = len(train)
        self._data = replace(self._data, train=train, description=f"{len(train)} frames of {len(train.drives)} bags")

    @property
    def _ahead(self) -> int:
        """Batches that are in the making."""
        return self._config.loader_threads + 2

    def _validate(self) -> None:
        normalisation.share_statistics(self.network, self._ranks)
        normalisation.share_statistics(self._working.averaged.network, self._ranks)
        network = self.judged()
        result, counts = validate(network, self._validation, self._precision, self._ranks)
        kinds, known = [counts], None
        if self._rehearsal:
            known, counts = validate(network, self._rehearsal, self._precision, self._ranks)
            kinds.append(counts)
        if known is not None and math.isinf(self.state.known_m):
            self.state.known_m = known.mae_80_m
        limit_m = (1 + self._config.rehearsal.tolerance) * self.state.known_m
        has_forgotten = known is not None and known.mae_80_m > limit_m
        is_best = result.mae_80_m < self.state.best_score and not has_forgotten
        self.state.validated_step = self.state.step
        self.state.worse += 1
        self._record("validation", asdict(result))
        if known is not None:
            self._record("rehearsal", asdict(known))
        if is_best:
            self.state.best_score, self.state.best_step, self.state.worse = result.mae_80_m, self.state.step, 0
            if self._ranks.is_first:
                calibration = platt_scaling(kinds, network.config.calibration)
                archive.save(network, self._card(result, known, calibration), self.archive_path)
        if self._ranks.is_first:
            self._write_page(network)
        self._observer.on_validation(ValidationReport(self.state.step, result, known, is_best))

    def _write_page(self, network: networks.Network) -> None:
        state, config = self.state, self._config
        shown = {f"validation frame {index}": sample for index, sample in first_middle_last(self._validation)}
        shown |= {f"rehearsed frame {index}": sample for index, sample in first_middle_last(self._rehearsal)[:1]}
        facts = (
            ("network", self._name),
            ("data", self._data.description),
            ("iterations", f"{state.step} of {config.iterations} in {state.elapsed_s / 60:.1f} minutes"),
            ("best", f"MAE within 80 m {state.best_score:.3f} m, of iteration {state.best_step}"),
            ("seed", str(config.seed)),
            ("computed in", f"{str(self._precision.dtype).removeprefix('torch.')} on {self._precision.device}"),
        )
        panels = panels_of(network, shown, self._precision)
        title = f"{self._name}: {self._folder.name}"
        write_page(self._folder / PAGE, title, facts, read_metrics(self._folder / METRICS), panels)

    def _card(
        self, result: ValidationResult, known: ValidationResult | None, calibration: tuple[float, float]
    ) -> archive.Card:
        length = f"{self.state.step} iterations, {self.state.position} samples, seed {self._config.seed}"
        results = {"validation": asdict(result), "rehearsal": asdict(known) if known else {}}
        metrics = {
            f"{kind}_{name}": round(value, 4)
            for kind, values in results.items()
            for name, value in values.items()
            if math.isfinite(value)
        }
        card = archive.Card.of(self.network, self._name, f"{self._data.description}; {length}", metrics)
        calibrated = {"calibration": [round(value, 4) for value in calibration]}
        return replace(card, architecture={**card.architecture, **calibrated})

    def _record(self, kind: str, values: dict[str, float]) -> None:
        if self._ranks.is_first:
            self._log.add(kind, self.state.step, values)

    def _agree(self, is_stopped: bool) -> bool:
        """Counts time, the first process's for all, and tells whether anybody wants to stop."""
        now = time.monotonic()
        elapsed_s = self.state.elapsed_s + now - self._counted_until
        self._counted_until = now
        own = torch.tensor([elapsed_s if self._ranks.is_first else 0.0, float(is_stopped)], dtype=torch.float64)
        elapsed_s, stops = self._ranks.add(own).tolist()
        self.state.elapsed_s = float(elapsed_s)
        return bool(stops)

    def _is_finished(self) -> bool:
        patience = self._config.validation.patience
        return self._progress() >= 1 or 0 < patience <= self.state.worse

    def _progress(self) -> float:
        progress = self.state.step / self._config.iterations
        if self._config.minutes is not None:
            progress = max(progress, self.state.elapsed_s / (60 * self._config.minutes))
        return min(progress, 1.0)


def _outputs_of(network: networks.Network, batch: Batch) -> Any:
    try:
        return network.train_outputs(batch.image, batch.radar, batch.valid, batch.ground)
    except ValueError as error:
        if "more than 1 value per channel" not in str(error):
            raise
        count, _, height, width = batch.image.shape
        raise TrainingError(
            f"{count} images of {height} x {width} pixels at once leave a batch norm a single value; give larger crops "
            "or a larger batch in the recipe's phases"
        ) from None
