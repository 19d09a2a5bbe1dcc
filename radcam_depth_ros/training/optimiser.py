"""The optimiser of a network's weights."""

from __future__ import annotations

import torch
from torch import nn

from radcam_depth_ros.training.recipe import OptimiserConfig


def optimiser_of(network: nn.Module, config: OptimiserConfig) -> torch.optim.AdamW:
    """AdamW for all weights of a network; its groups' `factor` is what `part_rates` says of them."""
    by_factor: dict[float, list[nn.Parameter]] = {}
    for name, parameter in network.named_parameters():
        by_factor.setdefault(config.part_rates.get(name.partition(".")[0], 1.0), []).append(parameter)
    groups = []
    for factor, parameters in by_factor.items():
        # Decay would draw norms, biases and attention's alpha and beta to 0, which regularises nothing.
        matrices, others = [p for p in parameters if p.ndim >= 2], [p for p in parameters if p.ndim < 2]
        groups.append({"params": matrices, "weight_decay": config.weight_decay, "factor": factor})
        groups.append({"params": others, "weight_decay": 0.0, "factor": factor})
    return torch.optim.AdamW(groups, lr=config.learning_rate)
