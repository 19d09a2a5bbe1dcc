"""Losses of the corrected road and of how uncertain it is."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean
from radcam_depth_ros.training.losses.truth import at_rows

GROUND_CLASSES = (0, 1)
"""Road and sidewalk, as training ids of Cityscapes: what lies on the road's plane."""

FARTHEST_ROAD_M = 60.0
"""The road's correction is learned from ground up to here: farther on, one plane seldom holds."""

ROAD_TOLERANCE = 0.2
"""Difference of the logarithms up to which a pixel of unknown class is taken for ground."""


def road_loss(road_m: Tensor, truth_m: Tensor, batch: Batch, told_m: Tensor | None, ranks: Ranks = ALONE) -> Tensor:
    """Mean absolute difference of the logarithms where the ground is.

    That is where a pixel's class says so or, where classes are not known, where truth and road are not far apart. On a
    picture that tells nothing the road as told is the truth, everywhere: it is not to be moved.

    Args:
        road_m: (B, 1, h, w) metres, of the image's size or smaller by a whole factor.
        truth_m: (B, 1, H, W) metres; NaN pixels do not count.
        batch: Its classes, and which pictures tell nothing.
        told_m: As `road_m`, the road as told; None: no picture tells nothing.
        ranks: As in `association_loss`.
    """
    difference, counts = _road_error(road_m, truth_m, batch.classes)
    if told_m is not None:
        tells = batch.readable.reshape(-1, 1, 1, 1)
        difference = torch.where(tells, difference, (torch.log(road_m) - torch.log(told_m)).abs())
        counts = counts | ~tells
    return masked_mean(difference, counts, ranks)


def deviation_loss(deviation: Tensor, road_m: Tensor, truth_m: Tensor, classes: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Negative log likelihood of the road's error on the ground, as of a Laplace distribution.

    Args:
        deviation: (B, 1, h, w), of the logarithm of the road's depth.
        road_m: As in `road_loss`, and so are the others; it gets no gradient from here.
        truth_m: See there.
        classes: (B, H, W) uint8, 255 unknown.
        ranks: As in `association_loss`.
    """
    difference, counts = _road_error(road_m.detach(), truth_m, classes)
    # A Laplace distribution's mean absolute difference is 1 / sqrt(2) of its deviation.
    spread = (deviation / 2**0.5).clamp(min=1e-3)
    return masked_mean(difference / spread + torch.log(spread), counts, ranks)


def abstention_loss(heard: Tensor, readable: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Binary cross entropy of how much of the correction is made against whether the picture tells anything.

    The road's error alone teaches it too slowly: it falls little before hardly any vote is heard.

    Args:
        heard: (B, 1), 0 to 1.
        readable: (B,) bool.
        ranks: As in `association_loss`.
    """
    entropy = functional.binary_cross_entropy(heard.clamp(1e-4, 1 - 1e-4), readable.float()[:, None], reduction="none")
    return masked_mean(entropy, torch.ones_like(entropy), ranks)


def _road_error(road_m: Tensor, truth_m: Tensor, classes: Tensor) -> tuple[Tensor, Tensor]:
    """Absolute difference of the logarithms, and where it counts: both (B, 1, h, w)."""
    truth, stride = at_rows(truth_m, road_m.shape[2]), truth_m.shape[2] // road_m.shape[2]
    label = classes[:, None, stride // 2 :: stride, stride // 2 :: stride]
    ground = torch.zeros_like(label, dtype=torch.bool)
    for number in GROUND_CLASSES:
        ground |= label == number
    counts = (truth > 0) & (truth <= FARTHEST_ROAD_M)
    difference = (torch.log(road_m) - torch.log(torch.where(counts, truth, 1.0))).abs()
    near = difference.detach() < ROAD_TOLERANCE
    # A plane has no business where the ground leaves it by half: a bank, a hole, another road.
    counts &= torch.where(label == UNKNOWN_CLASS, near, ground & (difference.detach() < 0.7))
    return difference, counts
