"""Losses of `lircdepth` ([Sun2025]) without those of distillation, which are in `distillation`.

`inter_depth` is not in the paper and is off by default.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from radcam_depth_ros.networks.lircdepth import LircdepthOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.baff import confidence_loss
from radcam_depth_ros.training.losses.masked import ALONE, halved
from radcam_depth_ros.training.losses.rectified import RectifiedLossConfig, dense_terms, depth_loss
from radcam_depth_ros.training.losses.truth import without_narrow_sky


@dataclass(frozen=True)
class LossConfig(RectifiedLossConfig):
    """Weights and thresholds of the losses, besides those of the dense depth.

    Attributes:
        inter_depth: Weight of an L1 on the depths within the decoder, halved from scale to scale in the order of
            decoding: what a teacher tells of them, told by the truth.
        confidence: Weight of the confidence's binary cross entropy; only its own head learns from it.
        confidence_tolerance: The dense depth is right when it is this near to the truth, relatively.
    """

    inter_depth: float
    confidence: float
    confidence_tolerance: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.confidence_tolerance <= 0:
            raise TrainingError(f"confidence_tolerance must be positive, got {self.confidence_tolerance}")


def total_loss(
    outputs: LircdepthOutputs, batch: Batch, max_depth_m: float, config: LossConfig, ranks: Ranks = ALONE
) -> tuple[Tensor, dict[str, Tensor]]:
    """All losses of a batch.

    Args:
        outputs: What the network gave.
        batch: What it was given, with ground truth.
        max_depth_m: Farthest depth that the network gives.
        config: Weights.
        ranks: The processes that share the batch; each gets its part of the losses, whose sum is that of the batch.

    Returns:
        The total, and its parts before weighting, by name; the parts pass no gradient.
    """
    dense_m = outputs.depths.dense.float()
    total, parts = dense_terms(dense_m, outputs.sky_logit, batch, max_depth_m, config, ranks)
    truth_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    if config.inter_depth > 0:
        inter_m = outputs.features.inter_depth_m
        parts["inter_depth"] = halved([depth_loss(given_m, truth_m, max_depth_m, ranks) for given_m in inter_m])
        total = total + config.inter_depth * parts["inter_depth"]
    if config.confidence > 0:
        logit = outputs.confidence_logit.float()
        parts["confidence"] = confidence_loss(logit, dense_m, truth_m, max_depth_m, config.confidence_tolerance, ranks)
        total = total + config.confidence * parts["confidence"]
    return total, {name: part.detach() for name, part in parts.items()}
