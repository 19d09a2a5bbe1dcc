"""Recipes of training: everything but the data and the architecture's defaults. Their values are in `recipes`."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from radcam_depth_ros import configuration, recipes
from radcam_depth_ros.drive import AccumulationConfig
from radcam_depth_ros.networks import registry
from radcam_depth_ros.training.data.augmentation import AugmentationConfig
from radcam_depth_ros.training.data.rehearsal import RehearsalConfig
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.distillation import DistillationConfig
from radcam_depth_ros.training.precision import Precision


class RecipeWarning(UserWarning):
    """A recipe of an earlier version, read as what it is called now."""


@dataclass(frozen=True)
class PhaseConfig:
    """A stretch of training.

    Attributes:
        share: Its share of the whole training; the shares of all phases sum to 1.
        crops: Heights and widths, multiples of 32; each batch takes one of them at random. Images come in many shapes,
            and a network that has seen one alone takes its border for a part of the street.
        batch: Samples an iteration.
        parts: Parts of the network that learn, by name; all when there are none. The others stay as they are.
    """

    share: float
    crops: tuple[tuple[int, int], ...]
    batch: int
    parts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        sides = [side for crop in self.crops for side in crop]
        if not sides or min(sides) < 32 or any(side % 32 for side in sides):
            raise TrainingError(f"crops must have sides that are multiples of 32, got {list(self.crops)}")
        if self.batch < 1 or self.share <= 0:
            raise TrainingError(f"a phase needs a batch and a share above 0, got {self.batch} and {self.share}")


_POWER = 0.9
"""Of the schedule `polynomial`."""


@dataclass(frozen=True)
class OptimiserConfig:
    """AdamW and its schedule.

    Attributes:
        learning_rate: At its highest. The paper's 2e-4 is for 400 epochs; an hour on two cores wants more.
        schedule: `cosine` from the highest rate to `final_share` of it; `polynomial`, the same by the power 0.9 of what
            is left of the training [Lee2019]; or `step`: at each of `milestones` it falls to `decay` of what it was (by
            default to half, for the last third).
        final_share: See `schedule`.
        milestones: Shares of the training, ascending.
        decay: See `schedule`.
        warm_up_iterations: The rate rises from 0 over these.
        weight_decay: Of AdamW; of weights with two dimensions or more, not of biases and norms.
        clip_norm: Greatest norm of the gradient; 0 for no limit.
        average_decay: Of the moving average of the weights, which is what is validated and shipped; 0 for none.
        part_rates: Factors of the learning rate for parts of the network; 1 for those left out.
    """

    learning_rate: float
    schedule: str
    final_share: float
    milestones: tuple[float, ...]
    decay: float
    warm_up_iterations: int
    weight_decay: float
    clip_norm: float
    average_decay: float
    part_rates: Mapping[str, float]

    def __post_init__(self) -> None:
        if self.schedule not in ("cosine", "polynomial", "step"):
            raise TrainingError(f"schedule must be 'cosine', 'polynomial' or 'step', got {self.schedule!r}")
        if self.learning_rate <= 0 or not 0 <= self.average_decay < 1 or self.clip_norm < 0:
            raise TrainingError(
                "learning_rate must be positive, average_decay in 0 to 1 and clip_norm at least 0, got "
                f"{self.learning_rate}, {self.average_decay} and {self.clip_norm}"
            )
        if not 0 < self.decay <= 1 or list(self.milestones) != sorted(self.milestones):
            raise TrainingError(
                f"decay must be above 0 and at most 1, and milestones ascending, got {self.decay} and {self.milestones}"
            )
        if min(self.part_rates.values(), default=0.0) < 0:
            raise TrainingError(f"part_rates must not be negative, got {min(self.part_rates.values())}")

    def rate(self, step: int, progress: float) -> float:
        """The learning rate of an iteration, `progress` (0 to 1) of the way through the training."""
        warm = min(1.0, (step + 1) / max(self.warm_up_iterations, 1))
        if self.schedule == "step":
            return self.learning_rate * warm * self.decay ** sum(progress >= share for share in self.milestones)
        progress = min(progress, 1.0)
        polynomial, cosine = (1 - progress) ** _POWER, 0.5 * (1 + math.cos(math.pi * progress))
        falling = polynomial if self.schedule == "polynomial" else cosine
        return self.learning_rate * warm * (self.final_share + (1 - self.final_share) * falling)


@dataclass(frozen=True)
class ValidationConfig:
    """How often and on how much the weights are judged.

    Attributes:
        every_iterations: Between two validations.
        frames: Number of frames, evenly over the validation bags.
        hold_out: Share of the bags (or, of a single bag, of its last frames) that is held out when no validation bags
            are given.
        patience: Validations in a row without a better score, after which a training ends; 0 for never.
    """

    every_iterations: int
    frames: int
    hold_out: float
    patience: int

    def __post_init__(self) -> None:
        if self.every_iterations < 1 or self.frames < 1 or not 0 < self.hold_out < 1 or self.patience < 0:
            raise TrainingError(
                "validation needs every_iterations and frames of at least 1, hold_out between 0 and 1 and patience of "
                f"at least 0, got {self.every_iterations}, {self.frames}, {self.hold_out} and {self.patience}"
            )


@dataclass(frozen=True)
class TrainingConfig:
    """A recipe.

    Attributes:
        architecture: Values of the network's config that differ from its defaults.
        iterations: Length of the training.
        minutes: Time limit of the training, over all resumptions, which may end it earlier: then the schedule follows
            the time. None for no limit.
        seed: Of weights, order and augmentation.
        precision: `float32`, `bfloat16`, or `auto`: see `engine.choose`.
        device: `cpu` or `cuda`.
        samples: Where they are while a network trains: on the `disk`, or in the memory of the `device`, which augments
            them, too.
        threads: CPU threads of torch; processes that share a batch keep the number that torchrun gives them.
        loader_threads: Threads that make batches.
        log_every_iterations: Between two lines of training losses.
        checkpoint_every_minutes: Between two checkpoints.
        tensorboard: Write the losses for TensorBoard as well.
        phases: Crops, and which parts learn.
        optimiser: Optimiser.
        loss: Weights and thresholds of the network's losses that differ from their defaults, see `criterion`.
        distillation: Weights of what a teacher tells, if there is one.
        augmentation: Augmentation.
        accumulation: How LiDAR scans become the truth that is learned from.
        validation: Validation.
        rehearsal: What is repeated of a former training.
        joint_norms: Batch norms go by the batches of all processes together, not by each one's part. It makes the
            result that of a single process, and an iteration take longer.
        freeze_statistics: Batch norms keep the statistics that they have, and learn their weights alone.
        initial_share: Share of the initial weights in those that are validated and shipped (WiSE-FT).
    """

    architecture: Mapping[str, Any]
    iterations: int
    minutes: float | None
    seed: int
    precision: str
    device: str
    samples: str
    threads: int
    loader_threads: int
    log_every_iterations: int
    checkpoint_every_minutes: float
    tensorboard: bool
    phases: tuple[PhaseConfig, ...]
    optimiser: OptimiserConfig
    loss: Mapping[str, Any]
    distillation: DistillationConfig
    augmentation: AugmentationConfig
    accumulation: AccumulationConfig
    validation: ValidationConfig
    rehearsal: RehearsalConfig
    joint_norms: bool
    freeze_statistics: bool
    initial_share: float

    def __post_init__(self) -> None:
        if not self.phases or abs(sum(phase.share for phase in self.phases) - 1) > 1e-6:
            raise TrainingError(f"the shares of all phases must sum to 1, got {[s.share for s in self.phases]}")
        if self.precision not in ("auto", "float32", "bfloat16"):
            raise TrainingError(f"precision must be 'auto', 'float32' or 'bfloat16', got {self.precision!r}")
        if self.samples not in ("disk", "device"):
            raise TrainingError(f"samples must be 'disk' or 'device', got {self.samples!r}")
        if min(self.iterations, self.threads, self.loader_threads, self.log_every_iterations) < 1:
            raise TrainingError("iterations, threads, loader_threads and log_every_iterations must be at least 1")
        if (self.minutes is not None and self.minutes <= 0) or not 0 <= self.initial_share < 1:
            raise TrainingError(
                "minutes must be above 0 and initial_share at least 0 and below 1, got "
                f"{self.minutes} and {self.initial_share}"
            )

    def require_parts(self, network: str, parts: Collection[str]) -> None:
        """Refuses names of parts that a network does not have.

        Args:
            network: Its name.
            parts: Names of its parts.

        Raises:
            TrainingError: for the first name that is none of them.
        """
        for named in (*(phase.parts for phase in self.phases), self.optimiser.part_rates):
            unknown = sorted(set(named) - set(parts))
            if unknown:
                raise TrainingError(
                    f"the recipe names {unknown[0]!r}, which is no part of {network}; its parts are "
                    f"{', '.join(parts) or 'not trained one by one'}"
                )

    def with_chosen_precision(self) -> TrainingConfig:
        """The same with `precision: auto` replaced by what it is here."""
        chosen = Precision.choose(self.precision, self.device)
        return replace(self, precision=str(chosen.dtype).removeprefix("torch."))

    def phase(self, progress: float) -> PhaseConfig:
        """The phase at `progress` (0 to 1) of the way through the training."""
        reached = 0.0
        for phase in self.phases[:-1]:
            reached += phase.share
            if progress < reached:
                return phase
        return self.phases[-1]


FINE_TUNING = "fine_tune"
"""Name of the recipe for weights that are trained already: gently, briefly, and rehearsing simulated drives."""


def recipe_of(name: str) -> TrainingConfig:
    """A recipe that comes with the package: a network's, by its name, or `FINE_TUNING`."""
    path = recipes.shipped(registry.trained_as(name))
    return build({} if path is None else {**configuration.read(path), "loss": {}}, str(path))


def load(path: Path) -> TrainingConfig:
    """Reads a recipe from a file that says what differs from `baff.yaml`; ConfigurationError where it does not fit."""
    return build(configuration.read(path), str(path))


def build(values: Mapping[str, Any], source: str = "the recipe") -> TrainingConfig:
    """The recipe of `baff`, without its architecture and losses, with some values replaced.

    Args:
        values: What differs.
        source: What to call them in errors.

    Raises:
        ConfigurationError: for an unknown key, or a value of the wrong type.
        TrainingError: for values that do not fit together.
    """
    values = dict(values)
    if "stages" in values:
        warnings.warn(f"{source} is of an earlier version: stages are called phases now", RecipeWarning, stacklevel=2)
        values["phases"] = values.pop("stages")
    return configuration.overlaid(_defaults(), values, source)


@functools.cache
def _defaults() -> TrainingConfig:
    path = recipes.shipped("baff")
    if path is None:
        raise TrainingError("the recipe baff.yaml of the package is missing; install the package again")
    return replace(configuration.load(TrainingConfig, path), loss={})
