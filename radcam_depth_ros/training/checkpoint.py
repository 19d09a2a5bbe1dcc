"""The state of a run on disk, and the moving average of weights.

A checkpoint is a working file of one run (`torch.save`, read with `weights_only`, so nothing in it is executed); what
ships is the archive, written by `networks.archive`.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from radcam_depth_ros.files import whole
from radcam_depth_ros.training.samples import TrainingError

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
        best_score: Lowest validation score so far.
        best_step: When that was.
        samples: Number of training samples: another number means other data.
        recent: Losses since the last line of the record, so that a resumed record is the same.
    """

    step: int = 0
    position: int = 0
    elapsed_s: float = 0.0
    best_score: float = float("inf")
    best_step: int = 0
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


def save_checkpoint(
    path: Path,
    state: RunState,
    network: nn.Module,
    averaged: AveragedWeights[Any],
    optimiser: torch.optim.Optimizer,
) -> None:
    """Writes all that a run needs to go on exactly as it would have.

    Raises:
        TrainingError: when it cannot be written; the checkpoint before it is intact.
    """
    content = {
        "state": asdict(state),
        "network": network.state_dict(),
        "averaged": averaged.network.state_dict(),
        "optimiser": optimiser.state_dict(),
        "torch_rng": torch.get_rng_state(),
    }
    with whole(path) as partial:
        try:
            torch.save(content, partial)
        except RuntimeError as error:  # what torch makes of a full disk
            raise TrainingError(f"cannot write {path} ({str(error).splitlines()[0]}); is the disk full?") from None


def load_checkpoint(
    path: Path, network: nn.Module, averaged: AveragedWeights[Any], optimiser: torch.optim.Optimizer
) -> RunState:
    """Restores a run.

    Raises:
        TrainingError: when the file is missing, damaged, or of another network.
    """
    if not path.is_file():
        raise TrainingError(f"there is no checkpoint {path} to resume; leave --resume out to start a run")
    try:
        content: Mapping[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        state = RunState(**{**content["state"], "recent": RecentLosses(**content["state"]["recent"])})
        network.load_state_dict(content["network"])
        averaged.network.load_state_dict(content["averaged"])
        optimiser.load_state_dict(content["optimiser"])
        rng: Tensor = content["torch_rng"]
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        reason = " ".join(str(error).split())[:200]
        raise TrainingError(f"the checkpoint {path} cannot be resumed: {reason}") from None
    torch.set_rng_state(rng)
    return state
