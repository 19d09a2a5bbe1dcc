"""Edge-aware smoothness loss: depth is smooth where the image is."""

from __future__ import annotations

import torch
from torch import Tensor

from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.masked import ALONE, sample_mean


def smoothness_loss(dense_m: Tensor, image: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Differences of neighbouring depths, weighing less where the image has an edge.

    Args:
        dense_m: (B, 1, H, W) metres.
        image: (B, 3, H, W), 0 to 1.
        ranks: As in `masked_mean`.
    """
    loss = dense_m.new_zeros(())
    for axis in (2, 3):
        edge = image.diff(dim=axis).abs().mean(dim=1, keepdim=True)
        loss = loss + sample_mean(torch.exp(-edge) * dense_m.diff(dim=axis).abs(), ranks)
    return loss
