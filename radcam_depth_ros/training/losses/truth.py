"""Ground truth as losses take it: at a smaller size, and without the sky that nobody asks for."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def at_rows(truth_m: Tensor, rows: int) -> Tensor:
    """Ground truth with so many rows: one pixel stands for its cell, since depths are never blended across edges.

    It is the middle one, or the nearest of the cell where that is unknown: a LiDAR knows few pixels, and none of them
    is to be lost.
    """
    stride = truth_m.shape[2] // rows
    if stride == 1:
        return truth_m
    middle = truth_m[:, :, stride // 2 :: stride, stride // 2 :: stride]
    # Sky is +inf, so that what is unknown needs a number beyond it: both are finite here.
    sky_m, unknown_m = 1e9, 2e9
    ranked = torch.where(torch.isnan(truth_m), unknown_m, truth_m.clamp(max=sky_m))
    nearest = -functional.max_pool2d(-ranked, stride)
    nearest = torch.where(nearest == sky_m, torch.inf, torch.where(nearest == unknown_m, torch.nan, nearest))
    return torch.where(torch.isnan(middle), nearest, middle)


def without_narrow_sky(truth_m: Tensor, margin_px: int) -> Tensor:
    """Ground truth (B, 1, H, W) whose sky within `margin_px` of a surface, along both axes, is unknown (NaN)."""
    surface = torch.isfinite(truth_m).float()
    side = 2 * margin_px + 1
    near = functional.max_pool2d(surface, (1, side), 1, (0, margin_px))
    near = functional.max_pool2d(near, (side, 1), 1, (margin_px, 0))
    return torch.where(torch.isinf(truth_m) & (near > 0), torch.nan, truth_m)
