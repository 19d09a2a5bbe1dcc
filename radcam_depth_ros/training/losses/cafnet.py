"""Losses of `cafnet`: stage 1's depth and confidence, and the dense depth ([Sun2024])."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.networks.cafnet import CafnetOutputs
from radcam_depth_ros.networks.layers.patches import Patches
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean
from radcam_depth_ros.training.losses.rectified import RectifiedLossConfig, dense_terms, depth_loss
from radcam_depth_ros.training.losses.truth import without_narrow_sky


@dataclass(frozen=True)
class LossConfig(RectifiedLossConfig):
    """Weights and thresholds of the losses, besides those of the dense depth.

    `coarse` and `confidence` are those of the public implementation of [Sun2024].

    Attributes:
        coarse: Weight of the L1 of stage 1's depth.
        confidence: Weight of the binary cross entropy of stage 1's confidence.
        tolerance_m: A pixel belongs to a return around it when their depths differ by less than this.
    """

    coarse: float
    confidence: float
    tolerance_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tolerance_m <= 0:
            raise TrainingError(f"tolerance_m must be positive, got {self.tolerance_m}")


def belonging(patches: Patches, radar: Tensor, truth_m: Tensor, tolerance_m: float) -> Tensor:
    """Which pixels belong to a return: they lie in its patch, and their depths are alike.

    Args:
        patches: Of these returns on this image.
        radar: (B, N, 6).
        truth_m: (B, 1, H, W) metres; NaN and +inf belong to none.
        tolerance_m: The depths differ by less than this.

    Returns:
        (B, 1, H, W) bool.
    """
    index, there = patches.pixels.flatten(1), patches.there.flatten(1)
    depth_m = radar[:, :, 2].unsqueeze(2).expand_as(patches.there).flatten(1)
    right = there & ((torch.gather(truth_m.flatten(1), 1, index) - depth_m).abs() < tolerance_m)
    nowhere = torch.zeros_like(truth_m).flatten(1)
    return (nowhere.scatter_reduce(1, index, right.to(nowhere.dtype), "amax") > 0).reshape(truth_m.shape)


def total_loss(
    outputs: CafnetOutputs, batch: Batch, max_depth_m: float, config: LossConfig, ranks: Ranks = ALONE
) -> tuple[Tensor, dict[str, Tensor]]:
    """All losses of a batch; arguments and result as `lircdepth_losses.total_loss`."""
    total, parts = dense_terms(outputs.depths.dense.float(), outputs.sky_logit, batch, max_depth_m, config, ranks)
    accumulated_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    if config.coarse > 0:
        parts["coarse"] = depth_loss(outputs.coarse_m.float(), accumulated_m, max_depth_m, ranks)
        total = total + config.coarse * parts["coarse"]
    if config.confidence > 0:
        label = belonging(outputs.patches, batch.radar, accumulated_m, config.tolerance_m)
        logit = outputs.confidence_logit.float()
        entropy = functional.binary_cross_entropy_with_logits(logit, label.float(), reduction="none")
        # What no ground truth knows is no negative; the sky is one.
        parts["confidence"] = masked_mean(entropy, ~torch.isnan(accumulated_m), ranks)
        total = total + config.confidence * parts["confidence"]
    return total, {name: part.detach() for name, part in parts.items()}
