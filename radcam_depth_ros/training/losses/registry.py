"""Losses of each network, found by its name.

The module of that name in this room has `LossConfig`, a dataclass of weights and thresholds, and `total_loss`; the
section `loss` of the recipe of that name has their values.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from radcam_depth_ros import configuration, recipes
from radcam_depth_ros.networks import registry
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError

TotalLoss = Callable[[Any, Batch, float, Any, Ranks], tuple[Tensor, dict[str, Tensor]]]
"""Outputs of a network, batch, farthest depth, config and processes, to the total and its parts by name."""


@dataclass(frozen=True)
class Criterion:
    """The losses of a network with their weights.

    Attributes:
        config: Weights and thresholds.
        total_loss: The losses.
    """

    config: Any
    total_loss: TotalLoss

    @classmethod
    def of(cls, network: str, values: Mapping[str, Any]) -> Criterion:
        """The losses of a network.

        Args:
            network: Its name.
            values: What differs from the default weights and thresholds.

        Raises:
            TrainingError: for a network that has no losses, or weights that do not fit together.
            ConfigurationError: for an unknown key.
        """
        name = registry.trained_as(network)
        path = recipes.shipped(name)
        if path is None or not _has_losses(name):
            known = ", ".join(known for known in registry.names() if _has_losses(registry.trained_as(known)))
            raise TrainingError(f"{network} cannot be trained: it has no losses; those that have: {known}")
        losses = importlib.import_module(f"{__package__}.{name}")
        usual = configuration.read(path).get("loss", {})
        config = configuration.build(losses.LossConfig, {**usual, **values}, f"the losses of {network}")
        return cls(config, losses.total_loss)

    def __call__(
        self, outputs: Any, batch: Batch, max_depth_m: float, ranks: Ranks
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Of what a network gave for a batch: the total, with its gradient, and its parts without, by name."""
        return self.total_loss(outputs, batch, max_depth_m, self.config, ranks)


def _has_losses(name: str) -> bool:
    return importlib.util.find_spec(f"{__package__}.{name}") is not None
