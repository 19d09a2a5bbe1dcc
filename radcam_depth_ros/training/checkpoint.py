"""The state of a run on disk, and the moving average of weights.

A checkpoint is a working file of one run (`torch.save`, read with `weights_only`, so nothing in it is executed); what
ships is the archive, written by `networks.archive`.
"""

from __future__ import annotations

import copy
import pickle  # nosec B403  # its error alone; torch reads with weights_only=True
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from radcam_depth_ros.files import whole
from radcam_depth_ros.training.errors import TrainingError

NetworkT = TypeVar("NetworkT", bound=nn.Module)


@dataclass
class RecentLosses:
    """Sums of the losses since they were last written down.

    Attributes:
        sums: By name.
        count: Number of iterations.
    """

    sums: dict[str, float] = field(default_factory=dict)
    count: int = 0

    def add(self, values: Mapping[str, float]) -> None:
        """Adds an iteration's; nothing of one that was skipped."""
        if not values:
            return
        self.sums = {name: self.sums.get(name, 0.0) + value for name, value in values.items()}
        self.count += 1

    def means(self) -> dict[str, float]:
        """Means over the iterations."""
        return {name: value / self.count for name, value in self.sums.items()}

    def clear(self) -> None:
        """Begins anew."""
        self.sums, self.count = {}, 0


@dataclass
class RunState:
    """Where a run stands.

    Attributes:
        step: Iterations done.
        position: Samples consumed.
        elapsed_s: Seconds trained, over all resumptions.
        best_score: Lowest validation error so far of weights that had not forgotten too much, metres.
        best_step: When that was.
        validated_step: When weights were last judged; -1 for never.
        known_m: Error on rehearsed drives when they were first judged; infinite before that.
        worse: Validations since the best one.
        skipped: Iterations in a row whose gradient was not finite.
        samples: Number of training samples: another number means other data.
        recent: Losses since the last line of the record, so that a resumed record is the same.
    """

    step: int = 0
    position: int = 0
    elapsed_s: float = 0.0
    best_score: float = float("inf")
    best_step: int = 0
    validated_step: int = -1
    known_m: float = float("inf")
    worse: int = 0
    skipped: int = 0
    samples: int = 0
    recent: RecentLosses = field(default_factory=RecentLosses)


class AveragedWeights(Generic[NetworkT]):
    """Exponential moving average of a network's weights and running statistics.

    Args:
        network: The network that is trained.
        decay: Weight of the past, lower in the first iterations; 0 gives the network's own weights.
    """

    def __init__(self, network: NetworkT, decay: float) -> None:
        self.network: NetworkT = copy.deepcopy(network).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        """Moves the average towards the network's weights after iteration `step`."""
        weight = 1.0 - min(self._decay, (1 + step) / (10 + step))
        averaged = self.network.state_dict()
        for name, value in network.state_dict().items():
            if value.is_floating_point():
                averaged[name].lerp_(value, weight)
            else:
                averaged[name].copy_(value)


@dataclass(frozen=True)
class Working:
    """What changes while a network is trained, besides the run's state.

    Attributes:
        network: The network.
        averaged: Moving average of its weights.
        optimiser: The optimiser.
        initial: Weights that the training started from, where they are needed again.
    """

    network: nn.Module
    averaged: AveragedWeights[Any]
    optimiser: torch.optim.Optimizer
    initial: dict[str, Tensor] = field(default_factory=dict)


def save_checkpoint(path: Path, state: RunState, working: Working) -> None:
    """Writes all that a run needs to go on exactly as it would have; the checkpoint before it is kept beside it.

    Raises:
        TrainingError: when it cannot be written; the checkpoint before it is intact.
    """
    content = {
        "state": asdict(state),
        "network": working.network.state_dict(),
        "averaged": working.averaged.network.state_dict(),
        "optimiser": working.optimiser.state_dict(),
        "initial": working.initial,
        "torch_rng": torch.get_rng_state(),
    }
    with whole(path) as partial:
        try:
            torch.save(content, partial)
        except RuntimeError as error:  # what torch makes of a full disk
            raise TrainingError(
                f"cannot write {path} ({str(error).splitlines()[0]}); is the disk full? The checkpoint before it is "
                "intact: make room and go on with --resume"
            ) from None
        if path.is_file():
            path.replace(before(path))


def load_checkpoint(path: Path, working: Working, on_note: Callable[[str], None] = lambda text: None) -> RunState:
    """Restores a run, from the checkpoint before where the last one is damaged.

    Args:
        path: The checkpoint.
        working: What is given its values.
        on_note: Told when the last one was damaged.

    Raises:
        TrainingError: when there is none, or none that can be read and is of this network.
    """
    found = [file for file in (path, before(path)) if file.is_file()]
    if not found:
        raise TrainingError(f"there is no checkpoint {path} to resume; leave --resume out to start a run")
    reasons = []
    for file in found:
        try:
            state = _load(file, working)
        except (OSError, RuntimeError, KeyError, TypeError, ValueError, EOFError, TrainingError) as error:
            reasons.append(" ".join(str(error).split())[:400])
            continue
        if reasons:
            on_note(f"{path} is damaged ({reasons[0]}); going on from {file.name}, iteration {state.step}")
        return state
    raise TrainingError(f"the checkpoint {path} cannot be resumed: {reasons[0]}")


def read_plain(path: Path) -> Any:
    """What `torch.save` wrote to a file: tensors and plain values. It is a pickle, of which nothing is executed.

    Raises:
        TrainingError: for a pickle that makes or calls anything else, or cannot be read as one.
        OSError, RuntimeError, EOFError: as torch has them for other files that it cannot read.
    """
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Detected pickle protocol", category=UserWarning)
            return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        # torch's own text advises to load the file without this check.
        called = re.search(r"GLOBAL (\S+) (?:was not|whose)", str(error))
        what = f"a pickle that would call {called[1]!r}" if called else "one that is damaged or none"
        raise TrainingError(
            f"expected a checkpoint of tensors at {path}, got {what}; nothing of it was run, take a file that you know"
        ) from None


def before(path: Path) -> Path:
    """Where the checkpoint before the last one is kept."""
    return path.with_name(f"{path.stem}.before{path.suffix}")


def _load(path: Path, working: Working) -> RunState:
    content: Mapping[str, Any] = read_plain(path)
    state = RunState(**{**content["state"], "recent": RecentLosses(**content["state"]["recent"])})
    working.network.load_state_dict(content["network"])
    working.averaged.network.load_state_dict(content["averaged"])
    working.optimiser.load_state_dict(content["optimiser"])
    working.initial.clear()
    working.initial.update(content["initial"])
    rng: Tensor = content["torch_rng"]
    torch.set_rng_state(rng)
    return state
