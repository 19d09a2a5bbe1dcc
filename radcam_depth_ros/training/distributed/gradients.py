"""Gradients that several processes share."""

from __future__ import annotations

import torch
from torch import nn

from radcam_depth_ros.training.distributed.ranks import Ranks


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
