"""Depth losses of `cafnet` and `lircdepth`: two ground truths, weighted by how far off each says the depth is.

Equation numbers are those of LiRCDepth (2025); METHODS C.
"""

from __future__ import annotations

import torch
from torch import Tensor

from radcam_depth_ros.training.masked import ALONE, masked_mean, sample_mean
from radcam_depth_ros.training.ranks import Ranks


def uncertainty(predicted_m: Tensor, truth_m: Tensor, beta: float) -> Tensor:
    """How far two depths are from each other, 0 for equal ones and below 1 (equation 4).

    Args:
        predicted_m: Metres, positive.
        truth_m: The same shape; 0 or more.
        beta: Relative difference at which it is 1 - 1 / e, the difference being relative to the sum of both.
    """
    return 1.0 - torch.exp(-(predicted_m - truth_m).abs() / (beta * (predicted_m + truth_m)))


def rectified_depth_loss(
    dense_m: Tensor,
    accumulated_m: Tensor,
    single_m: Tensor | None,
    max_depth_m: float,
    beta: float,
    ranks: Ranks = ALONE,
) -> Tensor:
    """The uncertainty-rectified depth loss (URDL, equation 6).

    An L1 on each ground truth, each pixel of it weighted by a softmax over the uncertainties of both. Where one of them
    is unknown it counts there as 0 m, as in the paper's images: what only accumulated scans know weighs less than half.
    The weights pass no gradient: else the network could lower one by moving away from the other truth.

    Args:
        dense_m: (B, 1, H, W) metres, positive.
        accumulated_m: The same size, NaN where unknown; what is beyond `max_depth_m` (the sky: +inf) does not count.
        single_m: The same of a single scan; None where one ground truth serves as both.
        max_depth_m: Farthest depth that the network gives.
        beta: As in `uncertainty`.
        ranks: As in `masked_mean`.
    """
    truths = [accumulated_m, accumulated_m if single_m is None else single_m]
    known = [(truth > 0) & (truth <= max_depth_m) for truth in truths]
    targets = [torch.where(there, truth, 0.0) for there, truth in zip(known, truths, strict=True)]
    off = [uncertainty(dense_m.detach(), target, beta) for target in targets]
    weights = torch.softmax(torch.stack(off), dim=0)
    loss = dense_m.new_zeros(())
    # Always both, so that all processes sum up equally often, whatever their parts of a batch hold.
    for weight, target, there in zip(weights, targets, known, strict=True):
        loss = loss + masked_mean(weight * (dense_m - target).abs(), there, ranks)
    return loss


def depth_loss(dense_m: Tensor, truth_m: Tensor, max_depth_m: float, ranks: Ranks = ALONE) -> Tensor:
    """L1 on one ground truth, over the pixels with a surface in range; arguments as in `rectified_depth_loss`."""
    known = (truth_m > 0) & (truth_m <= max_depth_m)
    return masked_mean((dense_m - torch.where(known, truth_m, 0.0)).abs(), known, ranks)


def sky_loss(dense_m: Tensor, truth_m: Tensor, max_depth_m: float, ranks: Ranks = ALONE) -> Tensor:
    """How far the depth is below the farthest where nothing is in range; arguments as in `rectified_depth_loss`."""
    return masked_mean(max_depth_m - dense_m, truth_m > max_depth_m, ranks)


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
