"""Means over known pixels, and sums of them over scales."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from radcam_depth_ros.training.distributed.ranks import Ranks

LEAST_SHARE = 0.001
"""Share of a sample's pixels from which on it counts in full: a scan of 16 beams knows one in a hundred."""

ALONE = Ranks()


def masked_mean(values: Tensor, weight: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Mean over the samples of each sample's weighted mean.

    A frame with a LiDAR's thousand pixels counts as much as a simulated one that knows them all: among rehearsed drives
    it would hardly be heard otherwise. What knows less than `LEAST_SHARE` of its pixels counts accordingly less.

    Args:
        values: (B, ...); what weighs nothing may be NaN.
        weight: The same shape, bool or not negative.
        ranks: The processes that share the batch: the mean is over all of it, and the sum of what each gets.
    """
    known = weight.flatten(1).sum(dim=1)
    # torch.where, not a product alone: what does not count may be NaN.
    total = (torch.where(weight > 0, values, 0.0) * weight).flatten(1).sum(dim=1)
    means = total / known.clamp(min=max(LEAST_SHARE * weight[0].numel(), 1e-6))
    return means.sum() / ranks.add((known > 0).sum()).clamp(min=1)


def sample_mean(values: Tensor, ranks: Ranks = ALONE) -> Tensor:
    """Mean over the samples (B, ...) of the joint batch; `ranks` as in `masked_mean`."""
    means = values.flatten(1).mean(dim=1)
    return means.sum() / ranks.add(torch.tensor(len(means), device=means.device))


def halved(terms: Sequence[Tensor]) -> Tensor:
    """The sum of terms, the first by 1/2, the next by 1/4 and so on."""
    return torch.stack([term / 2 ** (index + 1) for index, term in enumerate(terms)]).sum()
