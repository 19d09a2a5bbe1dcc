"""What `lircdepth` is trained to (LiRCDepth 2025, METHODS C), but for distillation: see `distillation`."""

from __future__ import annotations

from dataclasses import astuple, dataclass

from torch import Tensor

from radcam_depth_ros.networks import LircdepthOutputs
from radcam_depth_ros.training.batches import Batch
from radcam_depth_ros.training.losses import LossConfig, confidence_loss, without_narrow_sky
from radcam_depth_ros.training.masked import ALONE
from radcam_depth_ros.training.ranks import Ranks
from radcam_depth_ros.training.rectified import rectified_depth_loss, sky_loss, smoothness_loss
from radcam_depth_ros.training.samples import TrainingError


@dataclass(frozen=True)
class LircdepthLossConfig:
    """Weights and thresholds of the losses; a weight of 0 switches its term off.

    Attributes:
        depth: Weight of the uncertainty-rectified depth loss.
        beta: Of its uncertainty: the relative difference at which that is 1 - 1 / e.
        smoothness: Weight of the smoothness.
        sky: Weight of pixels without any surface or beyond the depth range, which are drawn to the farthest depth.
        sky_margin_px: Sky this near to a surface does not count.
        confidence: Weight of the confidence's binary cross entropy; only its own head learns from it.
        confidence_tolerance: The dense depth is right when it is this near to the truth, relatively.
    """

    depth: float = 1.0
    beta: float = 0.2
    smoothness: float = 0.001
    sky: float = 0.015
    sky_margin_px: int = 4
    confidence: float = 0.1
    confidence_tolerance: float = 0.1

    def __post_init__(self) -> None:
        if min(astuple(self)) < 0:
            raise TrainingError(f"values of the losses must not be negative, got {min(astuple(self))}")
        if min(self.beta, self.confidence_tolerance) <= 0:
            raise TrainingError(
                f"beta and confidence_tolerance must be positive, got {self.beta} and {self.confidence_tolerance}"
            )


def total_loss(
    outputs: LircdepthOutputs, batch: Batch, max_depth_m: float, config: LircdepthLossConfig, ranks: Ranks = ALONE
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
    accumulated_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    single_m = batch.depth_single_m
    total = dense_m.new_zeros(())
    parts: dict[str, Tensor] = {}
    if config.depth > 0:
        parts["depth"] = rectified_depth_loss(dense_m, accumulated_m, single_m, max_depth_m, config.beta, ranks)
        total = total + config.depth * parts["depth"]
    if config.smoothness > 0:
        parts["smoothness"] = smoothness_loss(dense_m, batch.image, ranks)
        total = total + config.smoothness * parts["smoothness"]
    if config.sky > 0:
        parts["sky"] = sky_loss(dense_m, accumulated_m, max_depth_m, ranks)
        total = total + config.sky * parts["sky"]
    if config.confidence > 0:
        judged = LossConfig(confidence_tolerance=config.confidence_tolerance)
        logit = outputs.confidence_logit.float()
        parts["confidence"] = confidence_loss(logit, dense_m, accumulated_m, max_depth_m, judged, ranks)
        total = total + config.confidence * parts["confidence"]
    return total, {name: part.detach() for name, part in parts.items()}
