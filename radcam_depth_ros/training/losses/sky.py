"""The loss of the sky's probability, where a network has it as an output."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.classes import CLASS_NAMES, WIRE
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.masked import ALONE, masked_mean

SKY_CLASS = 10
"""Training id of the sky."""

THIN_CLASSES = (*(CLASS_NAMES.index(name) for name in ("pole", "traffic light", "traffic sign")), WIRE)
THIN_WEIGHT = 6.0
"""A thin thing before the sky has few pixels, and is lost first."""

WIRE_WEIGHT = 12.0
"""A wire has fewer still."""


def sky_probability_loss(logit: Tensor, truth_m: Tensor, classes: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Binary cross entropy of the sky, in which thin things count `THIN_WEIGHT` times and wires `WIRE_WEIGHT` times.

    A cell of the logit that holds a pixel of a wire is the wire's: a wire is thinner than a cell.

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
    wire = functional.max_pool2d((classes[:, None] == WIRE).float(), stride) > 0
    unknown = torch.isnan(truth) & ~wire
    sky = (torch.isinf(truth) | (unknown & (label == SKY_CLASS))) & ~wire
    told = (sky | (label != UNKNOWN_CLASS)).flatten(1).any(dim=1).reshape(-1, 1, 1, 1)
    thin = torch.isin(label, label.new_tensor(THIN_CLASSES))
    surface = torch.where(wire, WIRE_WEIGHT, torch.where(thin, THIN_WEIGHT, 1.0))
    entropy = functional.binary_cross_entropy_with_logits(logit.float(), sky.float(), reduction="none")
    return masked_mean(entropy, torch.where(sky, 1.0, surface * ~unknown) * told, ranks)
