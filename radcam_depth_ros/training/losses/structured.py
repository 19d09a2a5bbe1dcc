"""Losses of `structured`: depth, weighted by class, and classes ([Li2023], section 3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.classes import CLASS_GROUPS, CLASS_NAMES, GROUP_OF_CLASS, ROAD_GROUP
from radcam_depth_ros.networks.structured import StructuredOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.baff import confidence_loss
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean
from radcam_depth_ros.training.losses.smoothness import smoothness_loss
from radcam_depth_ros.training.losses.truth import without_narrow_sky

_ROAD_CLASSES = tuple(
    number for number, group in enumerate(GROUP_OF_CLASS) if group == tuple(CLASS_GROUPS).index(ROAD_GROUP)
)


@dataclass(frozen=True)
class LossConfig:
    """Weights of the losses of `structured`; defaults are the paper's where it has one.

    Attributes:
        depths: Weight of depth, smoothness and coarse depth together (lambda 1).
        smoothness: Weight of the smoothness among these (lambda 2).
        coarse: Weight of the radar branch's coarse depth among these (lambda 3).
        road: omega, 0 to 2: the weight of pixels of the road's group of classes; others weigh 2 - omega, and those of
            unknown class 1.
        segmentation: Weight of the classes' cross entropy.
        sky: Weight in the depth's L1 of pixels without any surface or beyond the depth range, which are drawn to the
            farthest depth, relative to the others. Not in the paper, whose LiDAR knows no sky.
        sky_margin_px: Sky this near to a surface does not count: between twigs nobody knows, and nobody asks.
        confidence: Weight of the confidence's binary cross entropy. Not in the paper.
        confidence_tolerance: The dense depth is right when it is this near to the truth, relatively.
    """

    depths: float
    smoothness: float
    coarse: float
    road: float
    segmentation: float
    sky: float
    sky_margin_px: int
    confidence: float
    confidence_tolerance: float

    def __post_init__(self) -> None:
        weights = (self.depths, self.smoothness, self.coarse, self.segmentation, self.sky, self.confidence)
        if min(*weights, self.sky_margin_px) < 0:
            raise TrainingError(f"loss weights must not be negative, got {min(*weights, self.sky_margin_px)}")
        if not 0 <= self.road <= 2:
            raise TrainingError(f"road (omega) must lie between 0 and 2, got {self.road}")
        if self.confidence_tolerance <= 0:
            raise TrainingError(f"confidence_tolerance must be positive, got {self.confidence_tolerance}")


def total_loss(
    outputs: StructuredOutputs,
    batch: Batch,
    max_depth_m: float,
    config: LossConfig,
    ranks: Ranks = ALONE,
) -> tuple[Tensor, dict[str, Tensor]]:
    """All losses of a batch.

    Args:
        outputs: What the network gave.
        batch: What it was given. Depth is learned from the accumulated ground truth alone, as in the paper.
        max_depth_m: Farthest depth that the network gives.
        config: Weights.
        ranks: The processes that share the batch; each gets its part of the losses, whose sum is that of the batch.

    Returns:
        The total, and its parts by name before weighting, which pass no gradient.
    """
    truth_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    dense_m = outputs.depths.dense
    tolerance = config.confidence_tolerance
    parts = {
        "depth": depth_loss(dense_m, truth_m, batch.classes, max_depth_m, config, ranks),
        "smoothness": smoothness_loss(dense_m, batch.image, ranks),
        "coarse": coarse_loss(outputs.coarse_m, outputs.reached, truth_m, max_depth_m, ranks),
        "confidence": confidence_loss(outputs.confidence_logit, dense_m, truth_m, max_depth_m, tolerance, ranks),
    }
    depths = parts["depth"] + config.smoothness * parts["smoothness"] + config.coarse * parts["coarse"]
    total = config.depths * depths + config.confidence * parts["confidence"]
    if outputs.class_logits is not None:
        parts["segmentation"] = segmentation_loss(outputs.class_logits, batch.classes, ranks)
        total = total + config.segmentation * parts["segmentation"]
    return total, {name: part.detach() for name, part in parts.items()}


def depth_loss(
    dense_m: Tensor,
    truth_m: Tensor,
    classes: Tensor,
    max_depth_m: float,
    config: LossConfig,
    ranks: Ranks = ALONE,
) -> Tensor:
    """L1 in metres, by what a pixel shows (L_depth).

    Args:
        dense_m: (B, 1, H, W) metres.
        truth_m: The same size; NaN does not count, +inf or beyond `max_depth_m` is drawn to `max_depth_m`.
        classes: (B, H, W) uint8, 255 unknown.
        max_depth_m: Farthest depth that the network gives.
        config: `road` and `sky`.
        ranks: The processes that share the batch: the mean is over all of it, and the sum of what each gets.
    """
    counts = truth_m > 0
    beyond = truth_m > max_depth_m
    weight = torch.where(_is_known(classes), 2.0 - config.road, 1.0)
    weight = torch.where(_is_road(classes), config.road, weight).unsqueeze(1)
    weight = torch.where(beyond, config.sky * weight, weight)
    target = torch.where(counts, truth_m, 0.0).clamp(max=max_depth_m)
    # The paper divides by the number of pixels, not by their weights.
    return masked_mean(weight * (dense_m - target).abs(), counts, ranks)


def coarse_loss(coarse_m: Tensor, reached: Tensor, truth_m: Tensor, max_depth_m: float, ranks: Ranks = ALONE) -> Tensor:
    """L1 in metres of the radar branch's depth where a return reaches and a surface is in range (L_sparse).

    Args:
        coarse_m: (B, 1, H, W) metres.
        reached: The same size, bool.
        truth_m: The same size; NaN unknown, +inf sky.
        max_depth_m: Farthest depth that the network gives.
        ranks: As in `depth_loss`.
    """
    counts = reached & (truth_m > 0) & (truth_m <= max_depth_m)
    return masked_mean((coarse_m - torch.where(counts, truth_m, 0.0)).abs(), counts, ranks)


def segmentation_loss(class_logits: Tensor, classes: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Cross entropy over the pixels whose class is known (L_seg).

    Args:
        class_logits: (B, 19, H, W).
        classes: (B, H, W) uint8, 255 unknown.
        ranks: As in `depth_loss`.
    """
    known = _is_known(classes)
    entropy = functional.cross_entropy(class_logits, torch.where(known, classes, 0).long(), reduction="none")
    return masked_mean(entropy, known, ranks)


def _is_known(classes: Tensor) -> Tensor:
    return classes < len(CLASS_NAMES)


def _is_road(classes: Tensor) -> Tensor:
    return torch.isin(classes, torch.tensor(_ROAD_CLASSES, dtype=classes.dtype, device=classes.device))
