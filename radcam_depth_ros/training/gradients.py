"""From gradients to weights: the optimiser, and gradients that several processes share."""

from __future__ import annotations

import torch
from torch import nn

from radcam_depth_ros.training.ranks import Ranks
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


@torch.no_grad()
def share_gradients(network: nn.Module, ranks: Ranks) -> None:
    """Gives all processes the sum of their gradients; a weight that none has a gradient for gets none."""
    if ranks.size == 1:
        return
    parameters = [parameter for parameter in network.parameters() if parameter.requires_grad]
    has_gradient = parameters[0].new_tensor([float(parameter.grad is not None) for parameter in parameters])
    # One vector, since each exchange costs time whatever its size.
    parts = [p.new_zeros(p.numel()) if p.grad is None else p.grad.flatten() for p in parameters]
    total = ranks.add(torch.cat([has_gradient, *parts]))
    start = len(parameters)
    for index, parameter in enumerate(parameters):
        values = total[start : start + parameter.numel()]
        start += parameter.numel()
        parameter.grad = values.view_as(parameter).contiguous() if total[index] > 0 else None
