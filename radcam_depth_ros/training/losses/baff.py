"""Losses of `baff`: association, dense depth and confidence ([Electronics2025], section 3.6)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.classes import CLASS_NAMES, GROUP_OF_CLASS
from radcam_depth_ros.networks import Association, Candidates, TrainOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean
from radcam_depth_ros.training.losses.road import abstention_loss, deviation_loss, road_loss
from radcam_depth_ros.training.losses.sky import sky_probability_loss
from radcam_depth_ros.training.losses.truth import at_rows, without_narrow_sky

PARTS = (
    "association",
    "choice",
    "dense",
    "log_depth",
    "ranges",
    "road",
    "road_deviation",
    "abstention",
    "confidence",
    "sky",
    "geometry",
    "groups",
)
"""Losses by name, as they are logged."""

SMALL_THINGS = tuple(
    CLASS_NAMES.index(name)
    for name in ("pole", "traffic light", "traffic sign", "person", "rider", "motorcycle", "bicycle")
)
"""Training ids of what is thin or small and matters."""


@dataclass(frozen=True)
class LossConfig:
    """Weights and thresholds of the losses: how a network is trained, so no part of its architecture.

    Attributes:
        association: Weight of stage 1's binary cross entropy.
        association_tolerance_m: A pixel belongs to a return when their depths differ by less than this (the paper's
            0.4 m).
        association_tolerance_share: Widens the tolerance by this share of the depth; 0 is the paper's form.
        choice: Weight of the choice between candidates of depth, a cross entropy.
        choice_sky: Weight in it of pixels without a surface, relative to the others.
        choice_tolerance: Relative error of a candidate's depth at which it counts 1 / e as much as a right one.
        road: Weight of the corrected road's error, an L1 of the logarithm of depth on the ground.
        positive_weight: How much more a pixel that belongs to a return counts than one that does not: they are few.
        accumulated: Weight of the smooth L1 on the accumulated ground truth (exact depth in simulated drives).
        single: Weight of the smooth L1 on the single scan's ground truth; both are 1 in the paper.
        smooth_l1_beta_m: Error from which on the smooth L1 is linear.
        sky: Weight of pixels without any surface or beyond the depth range, which are drawn to the farthest depth,
            relative to the others.
        sky_margin_px: Sky this near to a surface does not count: between twigs nobody knows, and nobody asks.
        log_depth: Weight of an L1 on the logarithm of depth, which counts a tenth of the distance alike near and far;
            0 is the paper's loss.
        confidence: Weight of the confidence's binary cross entropy.
        confidence_tolerance: The dense depth is right when it is this near to the truth, relatively.
        sky_probability: Weight of the binary cross entropy of the sky, where a network tells it.
        geometry: Weight of how much farther off than geometry's the dense depth of a frame is, where both are mixed.
        ranges: Weight of the mean absolute error within 50 and 80 m, depths clipped to each, as they are measured.
        road_deviation: Weight of the likelihood of the corrected road's error, by the deviation that is told.
        abstention: Weight of the binary cross entropy of how much of the road's correction is made.
        groups: Weight of the cross entropy of the groups of classes, where a network tells them in training.
        small_things: How much more pixels of people, cycles, poles and signs count in the choice and the logarithm of
            depth: they are few.
    """

    association: float
    association_tolerance_m: float
    association_tolerance_share: float
    positive_weight: float
    choice: float
    choice_sky: float
    choice_tolerance: float
    road: float
    accumulated: float
    single: float
    smooth_l1_beta_m: float
    sky: float
    sky_margin_px: int
    log_depth: float
    confidence: float
    confidence_tolerance: float
    sky_probability: float
    geometry: float
    ranges: float
    road_deviation: float
    abstention: float
    groups: float
    small_things: float

    def __post_init__(self) -> None:
        weights = (
            self.association,
            self.accumulated,
            self.single,
            self.sky,
            self.log_depth,
            self.confidence,
            self.choice,
            self.road,
            self.choice_sky,
            self.sky_margin_px,
            self.association_tolerance_share,
            self.sky_probability,
            self.geometry,
            self.ranges,
            self.road_deviation,
            self.abstention,
            self.groups,
        )
        if min(weights) < 0:
            raise TrainingError(f"loss weights must not be negative, got {min(weights)}")
        positive = (
            self.association_tolerance_m,
            self.positive_weight,
            self.smooth_l1_beta_m,
            self.confidence_tolerance,
            self.choice_tolerance,
            self.small_things,
        )
        if min(positive) <= 0:
            raise TrainingError(
                "association_tolerance_m, choice_tolerance, positive_weight, smooth_l1_beta_m, small_things and "
                f"confidence_tolerance must be positive, got {min(positive)}"
            )


def association_loss(association: Association, truth_m: Tensor, config: LossConfig, ranks: Ranks = ALONE) -> Tensor:
    """Binary cross entropy of every logit whose pixel has ground truth.

    Args:
        association: Logits (B, M, h, w) with the depths of their returns.
        truth_m: (B, 1, H, W) metres; NaN pixels do not count, +inf (sky) belongs to no return.
        config: Tolerance and weight of positives.
        ranks: The processes that share the batch: the mean is over all of it, and the sum of what each gets.

    Returns:
        A scalar: the mean over samples of that over the pixels and returns that count, a positive counting
        `positive_weight` times.
    """
    logits, depth, columns = association
    truth = at_rows(truth_m, logits.shape[2])
    if columns is not None:
        index = columns.clamp(min=0).unsqueeze(2).expand(-1, -1, logits.shape[2], -1)
        truth = torch.gather(truth.expand(-1, logits.shape[1], -1, -1), 3, index)
        depth = torch.where(columns.unsqueeze(2) >= 0, depth, torch.nan)
    tolerance = config.association_tolerance_m + config.association_tolerance_share * depth
    counts = ~torch.isnan(truth - depth)
    positive = ((truth - depth).abs() < tolerance).expand_as(logits)
    weight = torch.where(positive, config.positive_weight, 1.0)
    entropy = functional.binary_cross_entropy_with_logits(logits.float(), positive.float(), weight, reduction="none")
    return masked_mean(entropy, counts.expand_as(logits), ranks)


def choice_loss(
    candidates: Candidates,
    truth_m: Tensor,
    weight: Tensor,
    max_depth_m: float,
    config: LossConfig,
    ranks: Ranks = ALONE,
) -> Tensor:
    """Negative log likelihood of the depth, as a mixture of a Laplace distribution of log depth at each candidate.

    Args:
        candidates: What the network chooses between.
        truth_m: (B, 1, H, W) metres; NaN pixels do not count, +inf (sky) and what is beyond `max_depth_m` is there.
        weight: (B, 1, H, W), of each pixel, see `thing_weight`.
        max_depth_m: Farthest depth that the network gives.
        config: `choice_tolerance`.
        ranks: As in `association_loss`.
    """
    truth = at_rows(truth_m, candidates.logits.shape[2])
    counts = ~torch.isnan(truth)
    stride = weight.shape[2] // truth.shape[2]
    weight = weight[:, :, stride // 2 :: stride, stride // 2 :: stride]
    weight = torch.where(torch.isinf(truth), config.choice_sky, weight) * counts
    truth = torch.log(torch.where(counts, truth, 1.0).clamp(0.1, max_depth_m))
    logits = candidates.logits.float()
    distance = (torch.log(candidates.depth_m) - truth).abs() / config.choice_tolerance
    likelihood = torch.logsumexp(logits - distance, dim=1, keepdim=True) - torch.logsumexp(logits, dim=1, keepdim=True)
    return masked_mean(-likelihood, weight, ranks)


def dense_loss(
    dense_m: Tensor, truth_m: Tensor, max_depth_m: float, config: LossConfig, ranks: Ranks = ALONE
) -> Tensor:
    """Smooth L1 in metres, means over the pixels with a surface in range and, weighted `sky`, over those without.

    Args:
        dense_m: (B, 1, H, W) metres.
        truth_m: The same size; NaN unknown, +inf or beyond `max_depth_m` is drawn to `max_depth_m`.
        max_depth_m: Farthest depth that the network gives.
        config: `smooth_l1_beta_m` and `sky`.
        ranks: As in `association_loss`.
    """
    beyond = truth_m > max_depth_m
    in_range = (truth_m > 0) & ~beyond
    target = torch.where(in_range, truth_m, max_depth_m)
    error = functional.smooth_l1_loss(dense_m, target, reduction="none", beta=config.smooth_l1_beta_m)
    return masked_mean(error, in_range, ranks) + config.sky * masked_mean(error, beyond, ranks)


def log_depth_loss(
    dense_m: Tensor, truth_m: Tensor, max_depth_m: float, ranks: Ranks = ALONE, weight: Tensor | None = None
) -> Tensor:
    """Mean absolute difference of the logarithms, over the pixels with a surface in range; shapes as `dense_loss`."""
    in_range = (truth_m > 0) & (truth_m <= max_depth_m)
    difference = (torch.log(dense_m) - torch.log(torch.where(in_range, truth_m, 1.0))).abs()
    return masked_mean(difference, in_range if weight is None else in_range * weight, ranks)


def thing_weight(classes: Tensor, factor: float) -> Tensor:
    """(B, 1, H, W) float32 of (B, H, W) uint8 classes: `factor` for people, cycles, poles and signs, else 1."""
    table = classes.new_ones(256, dtype=torch.float32)
    table[list(SMALL_THINGS)] = factor
    return table[classes.long()].unsqueeze(1)


def group_loss(logits: Tensor, classes: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Cross entropy of the groups of classes.

    Args:
        logits: (B, groups, h, w), smaller than the image by a whole factor.
        classes: (B, H, W) uint8; 255, unknown, does not count.
        ranks: As in `association_loss`.
    """
    stride = classes.shape[1] // logits.shape[2]
    label = classes[:, stride // 2 :: stride, stride // 2 :: stride].long()
    known = label < len(GROUP_OF_CLASS)
    group = torch.tensor(GROUP_OF_CLASS, device=label.device)[torch.where(known, label, 0)]
    entropy = functional.cross_entropy(logits.float(), group, reduction="none")
    return masked_mean(entropy, known, ranks)


def confidence_loss(
    logit: Tensor, dense_m: Tensor, truth_m: Tensor, max_depth_m: float, tolerance: float, ranks: Ranks = ALONE
) -> Tensor:
    """Binary cross entropy against whether the dense depth, taken as it is, is right; shapes as `dense_loss`.

    It is right when it is nearer to the truth than `tolerance`, relatively.
    """
    in_range = (truth_m > 0) & (truth_m <= max_depth_m)
    right = (dense_m.detach() - truth_m).abs() < tolerance * truth_m
    entropy = functional.binary_cross_entropy_with_logits(logit, right.float(), reduction="none")
    return masked_mean(entropy, in_range, ranks)


def geometry_loss(dense_m: Tensor, geometry_m: Tensor, truth_m: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """How much farther off than geometry's the dense depth of each frame is, as a share, within 50 and 80 m.

    Args:
        dense_m: (B, 1, H, W) metres.
        geometry_m: (B, 1, h, w) metres, smaller by a whole factor.
        truth_m: As `dense_m`; NaN and +inf do not count.
        ranks: As in `association_loss`.
    """
    stride = truth_m.shape[2] // geometry_m.shape[2]
    truth, dense_m = truth_m[:, :, ::stride, ::stride], dense_m[:, :, ::stride, ::stride]
    worse = dense_m.new_zeros((len(dense_m), 1))
    for limit_m in (50.0, 80.0):
        counts = ((truth > 0) & (truth <= limit_m)).float()
        target = torch.where(counts > 0, truth, 1.0)
        own, other = (
            ((depth.clamp(max=limit_m) - target).abs() * counts).sum(dim=(2, 3)) for depth in (dense_m, geometry_m)
        )
        # A little better is asked for, so that frames it has not seen are not worse.
        worse = worse + functional.relu(own / other.clamp(min=1e-3) - 0.97).clamp(max=3.0) * (other > 0)
    return masked_mean(worse, torch.ones_like(worse), ranks)


def range_loss(dense_m: Tensor, truth_m: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Mean absolute error of each frame within 50 and 80 m, depths clipped to each, as it is measured.

    Args:
        dense_m: (B, 1, H, W) metres.
        truth_m: The same size; NaN and +inf do not count.
        ranks: As in `association_loss`.
    """
    errors = []
    for limit_m in (50.0, 80.0):
        counts = (truth_m > 0) & (truth_m <= limit_m)
        # A depth beyond the range still gets a gradient: a hundredth of it.
        clipped = torch.where(dense_m < limit_m, dense_m, limit_m + 0.01 * (dense_m - limit_m))
        errors.append(masked_mean((clipped - torch.where(counts, truth_m, 1.0)).abs(), counts, ranks))
    return torch.stack(errors).mean()


def total_loss(
    outputs: TrainOutputs, batch: Batch, max_depth_m: float, config: LossConfig, ranks: Ranks = ALONE
) -> tuple[Tensor, dict[str, Tensor]]:
    """All losses of a batch.

    Args:
        outputs: What the network gave.
        batch: With the ground truth of many scans, or the exact depth, and that of a single scan where it is another.
        max_depth_m: Farthest depth that the network gives.
        config: Weights.
        ranks: The processes that share the batch; each gets its part of the losses, whose sum is that of the batch.

    Returns:
        The total, and its parts before weighting, which pass no gradient; 0 for what the network gave nothing for.
    """
    accumulated_m = without_narrow_sky(batch.depth_accumulated_m, config.sky_margin_px)
    single_m = None if batch.depth_single_m is None else without_narrow_sky(batch.depth_single_m, config.sky_margin_px)
    total = accumulated_m.new_zeros(())
    parts = dict.fromkeys(PARTS, total)
    if outputs.association is not None:
        parts["association"] = association_loss(outputs.association, accumulated_m, config, ranks)
        total = total + config.association * parts["association"]
    if outputs.depths is not None and outputs.confidence_logit is not None:
        weight = thing_weight(batch.classes, config.small_things)
        if outputs.candidates is not None:
            parts["choice"] = choice_loss(outputs.candidates, accumulated_m, weight, max_depth_m, config, ranks)
        if outputs.road_m is not None:
            parts["road"] = road_loss(outputs.road_m, accumulated_m, batch, outputs.told_m, ranks)
        dense_m, logit = outputs.depths.dense.float(), outputs.confidence_logit.float()
        parts["dense"] = single = dense_loss(dense_m, accumulated_m, max_depth_m, config, ranks)
        # Whether a part of a batch has a single scan's truth differs, but all processes must sum up as often as the
        # others.
        if single_m is not None or ranks.size > 1:
            single = dense_loss(dense_m, accumulated_m if single_m is None else single_m, max_depth_m, config, ranks)
        parts["confidence"] = confidence_loss(
            logit, dense_m, accumulated_m, max_depth_m, config.confidence_tolerance, ranks
        )
        if config.log_depth > 0:
            parts["log_depth"] = log_depth_loss(dense_m, accumulated_m, max_depth_m, ranks, weight)
        if outputs.group_logits is not None:
            parts["groups"] = group_loss(outputs.group_logits, batch.classes, ranks)
            total = total + config.groups * parts["groups"]
        if config.ranges > 0:
            parts["ranges"] = range_loss(dense_m, accumulated_m, ranks)
        total = total + config.choice * parts["choice"] + config.road * parts["road"] + config.single * single
        total = total + config.accumulated * parts["dense"] + config.confidence * parts["confidence"]
        total = total + config.log_depth * parts["log_depth"] + config.ranges * parts["ranges"]
        total = total + _mix_losses(parts, outputs, batch, accumulated_m, max_depth_m, config, ranks)
    return total, {name: value.detach() for name, value in parts.items()}


def _mix_losses(
    parts: dict[str, Tensor],
    outputs: TrainOutputs,
    batch: Batch,
    accumulated_m: Tensor,
    max_depth_m: float,
    config: LossConfig,
    ranks: Ranks,
) -> Tensor:
    """Losses of the sky, the road's deviation and the mix with geometry, weighted; each is put into `parts`."""
    total = accumulated_m.new_zeros(())
    if outputs.depths is None or outputs.own_m is None or outputs.geometry_m is None or outputs.sky_logit is None:
        return total
    parts["sky"] = sky_probability_loss(outputs.sky_logit, accumulated_m, batch.classes, ranks)
    truth_m = at_rows(accumulated_m, outputs.own_m.shape[2])
    total = total + config.log_depth * log_depth_loss(outputs.own_m, truth_m, max_depth_m, ranks)
    parts["geometry"] = geometry_loss(outputs.depths.dense.float(), outputs.geometry_m, accumulated_m, ranks)
    if outputs.road_m is not None and outputs.road_deviation is not None:
        if outputs.heard is not None:
            parts["abstention"] = abstention_loss(outputs.heard, batch.readable, ranks)
        parts["road_deviation"] = deviation_loss(
            outputs.road_deviation, outputs.road_m, accumulated_m, batch.classes, ranks
        )
    total = total + config.sky_probability * parts["sky"] + config.geometry * parts["geometry"]
    return total + config.road_deviation * parts["road_deviation"] + config.abstention * parts["abstention"]
