"""Which losses each network is trained by: registering one here makes a network trainable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from radcam_depth_ros import configuration
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses import baff as losses
from radcam_depth_ros.training.losses import cafnet as cafnet_losses
from radcam_depth_ros.training.losses import lircdepth as lircdepth_losses
from radcam_depth_ros.training.losses import structured as structured_losses

TotalLoss = Callable[[Any, Batch, float, Any, Ranks], tuple[Tensor, dict[str, Tensor]]]
"""Outputs of a network, batch, farthest depth, config and processes, to the total and its parts by name."""

_KINDS: dict[str, tuple[type[Any], TotalLoss]] = {
    "baff": (losses.LossConfig, losses.total_loss),
    "baff_paper": (losses.LossConfig, losses.total_loss),
    "baseline": (losses.LossConfig, losses.total_loss),
    "cafnet": (cafnet_losses.CafnetLossConfig, cafnet_losses.total_loss),
    "lircdepth": (lircdepth_losses.LircdepthLossConfig, lircdepth_losses.total_loss),
    "structured": (structured_losses.StructuredLossConfig, structured_losses.total_loss),
}
"""By network: the dataclass of weights and thresholds, and the losses that they belong to."""


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
        if network not in _KINDS:
            raise TrainingError(f"{network} cannot be trained: it has no losses; those that have: {', '.join(_KINDS)}")
        config_type, total_loss = _KINDS[network]
        return cls(configuration.build(config_type, values, f"the losses of {network}"), total_loss)

    def __call__(
        self, outputs: Any, batch: Batch, max_depth_m: float, ranks: Ranks
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Of what a network gave for a batch: the total, with its gradient, and its parts without, by name."""
        return self.total_loss(outputs, batch, max_depth_m, self.config, ranks)
