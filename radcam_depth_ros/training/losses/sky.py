"""The loss of the sky's probability, where a network has it as an output."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean

SKY_CLASS = 10
"""Training id of the sky."""

SURFACE_WEIGHT = 2.0
"""A lost surface is worse than a wall in the sky."""


def sky_probability_loss(logit: Tensor, truth_m: Tensor, classes: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Binary cross entropy of the sky, in which a surface counts `SURFACE_WEIGHT` times.

    A sample without classes and without any sky in its truth is a LiDAR's, which never sees the sky: it does not count,
    or a network that learns from such samples alone would forget the sky.

    Args:
        logit: (B, 1, h, w), smaller than the truth by a whole factor.
        truth_m: (B, 1, H, W) metres; +inf is the sky, NaN is the sky where its class says so and does not count else.
        classes: (B, H, W) uint8, 255 unknown.
        ranks: As in `association_loss`.
    """
    stride = truth_m.shape[2] // logit.shape[2]
    truth, label = truth_m[:, :, ::stride, ::stride], classes[:, None, ::stride, ::stride]
    unknown = torch.isnan(truth)
    sky = torch.isinf(truth) | (unknown & (label == SKY_CLASS))
    told = (sky | (label != UNKNOWN_CLASS)).flatten(1).any(dim=1).reshape(-1, 1, 1, 1)
    entropy = functional.binary_cross_entropy_with_logits(logit.float(), sky.float(), reduction="none")
    return masked_mean(entropy, torch.where(sky, 1.0, SURFACE_WEIGHT * ~unknown) * told, ranks)
