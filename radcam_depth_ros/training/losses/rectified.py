"""Depth losses of `cafnet` and `lircdepth`: two ground truths, weighted by how far off each says the depth is.

Equation numbers are those of [Sun2025].
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import torch
from torch import Tensor

from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.baff import log_depth_loss
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean
from radcam_depth_ros.training.losses.sky import sky_probability_loss
from radcam_depth_ros.training.losses.smoothness import smoothness_loss
from radcam_depth_ros.training.losses.truth import without_narrow_sky


@dataclass(frozen=True)
class RectifiedLossConfig:
    """Weights and thresholds of what both networks learn of the dense depth; a weight of 0 switches its term off.

    Attributes:
        depth: Weight of the uncertainty-rectified depth loss.
        beta: Of its uncertainty: the relative difference at which that is 1 - 1 / e.
        smoothness: Weight of the smoothness.
        sky: Weight of pixels without any surface or beyond the depth range, which are drawn to the farthest depth.
        sky_margin_px: Sky this near to a surface does not count.
        sky_probability: Weight of the binary cross entropy of the sky, where the network tells it. Not in the papers.
        log_depth: Weight of an L1 on the logarithm of the dense depth, which counts a tenth of the distance alike near
            and far. It is not in the papers.
    """

    depth: float
    beta: float
    smoothness: float
    sky: float
    sky_margin_px: int
    log_depth: float
    sky_probability: float

    def __post_init__(self) -> None:
        if min(astuple(self)) < 0:
            raise TrainingError(f"values of the losses must not be negative, got {min(astuple(self))}")
        if self.beta <= 0:
            raise TrainingError(f"beta must be positive, got {self.beta}")


def dense_terms(
    dense_m: Tensor,
    sky_logit: Tensor | None,
    batch: Batch,
    max_depth_m: float,
    config: RectifiedLossConfig,
    ranks: Ranks = ALONE,
) -> tuple[Tensor, dict[str, Tensor]]:
    """The losses of the dense depth and of the sky.

    Args:
        dense_m: (B, 1, H, W) metres.
        sky_logit: (B, 1, H, W), where the network tells the sky.
        batch: What the network was given, with ground truth.
        max_depth_m: Farthest depth that the network gives.
        config: Weights.
        ranks: The processes that share the batch; each gets its part of the losses, whose sum is that of the batch.

    Returns:
        The total, and its parts before weighting, by name.
    """
    accumulated_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    total = dense_m.new_zeros(())
    parts: dict[str, Tensor] = {}
    if config.depth > 0:
        single_m = batch.depth_single_m
        parts["depth"] = rectified_depth_loss(dense_m, accumulated_m, single_m, max_depth_m, config.beta, ranks)
        total = total + config.depth * parts["depth"]
    if config.smoothness > 0:
        parts["smoothness"] = smoothness_loss(dense_m, batch.image, ranks)
        total = total + config.smoothness * parts["smoothness"]
    if config.sky > 0:
        parts["sky"] = sky_loss(dense_m, accumulated_m, max_depth_m, ranks)
        total = total + config.sky * parts["sky"]
    if config.log_depth > 0:
        parts["log_depth"] = log_depth_loss(dense_m, accumulated_m, max_depth_m, ranks)
        total = total + config.log_depth * parts["log_depth"]
    if sky_logit is not None and config.sky_probability > 0:
        parts["sky_probability"] = sky_probability_loss(sky_logit, accumulated_m, batch.classes, ranks)
        total = total + config.sky_probability * parts["sky_probability"]
    return total, parts


def uncertainty(predicted_m: Tensor, truth_m: Tensor, beta: float) -> Tensor:
    """How far two depths are from each other, 0 for equal ones and below 1 ([Sun2025], eq. 4).

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
    """The uncertainty-rectified depth loss (URDL, [Sun2025], eq. 6).

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
