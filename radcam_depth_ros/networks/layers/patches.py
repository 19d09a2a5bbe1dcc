"""Cuts patches of an image around radar returns: pixels that may belong to a return, as radars measure height badly."""

from typing import NamedTuple

import torch
from torch import Tensor

from radcam_depth_ros.networks.config import ArchitectureError


class Patches(NamedTuple):
    """The pixels around each return.

    pixels: (B, N, P) int64, row * width + column; 0 for a pixel that is not there.
    there: (B, N, P) bool, whether the pixel is within the image and the return is valid.
    """

    pixels: Tensor
    there: Tensor


def check_patch(size_px: tuple[int, int]) -> None:
    """Refuses rows and columns of a patch that no return can be in the middle of, by an ArchitectureError."""
    if min(size_px) < 1 or not all(side % 2 for side in size_px):
        raise ArchitectureError(f"patch_px must be two odd numbers of pixels, got {size_px}")


def around(radar: Tensor, valid: Tensor, height: int, width: int, size_px: tuple[int, int]) -> Patches:
    """The patches of returns on an image.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        height: Rows of the image.
        width: Columns of the image.
        size_px: Rows and columns of a patch, odd; a return is in the middle of its patch.
    """
    rows = torch.arange(size_px[0], device=radar.device) - size_px[0] // 2
    columns = torch.arange(size_px[1], device=radar.device) - size_px[1] // 2
    row = torch.floor(radar[:, :, 1].float() + 0.5).unsqueeze(2) + rows.repeat_interleave(size_px[1])
    column = torch.floor(radar[:, :, 0].float() + 0.5).unsqueeze(2) + columns.repeat(size_px[0])
    there = valid.unsqueeze(2) & (row >= 0) & (row < height) & (column >= 0) & (column < width)
    return Patches(torch.where(there, row * width + column, torch.zeros_like(row)).long(), there)


def covered(patches: Patches, height: int, width: int) -> Tensor:
    """Which pixels lie in any patch, (B, 1, height, width) bool."""
    empty = torch.zeros(patches.pixels.shape[0], height * width, device=patches.pixels.device)
    hits = empty.scatter_reduce(1, patches.pixels.flatten(1), patches.there.flatten(1).float(), "amax")
    return (hits > 0).reshape(-1, 1, height, width)


def alike(patches: Patches, radar: Tensor, depth_m: Tensor, tolerance: float) -> Tensor:
    """The depth of the return around each pixel that is most like the depth there.

    Args:
        patches: Of these returns on this image.
        radar: (B, N, 6).
        depth_m: (B, 1, H, W) metres.
        tolerance: How far, as a share of the depth, the return's may be off.

    Returns:
        (B, 1, H, W) float32 metres, NaN where no patch reaches, or no return in it is within the tolerance.
    """
    height, width = depth_m.shape[2], depth_m.shape[3]
    there, index = patches.there.flatten(1), patches.pixels.flatten(1)
    seen = torch.gather(depth_m.float().flatten(1), 1, index)
    returned = radar[:, :, 2].float().unsqueeze(2).expand_as(patches.there).flatten(1)
    off = (returned - seen).abs() / seen
    # 1e9 stands for no depth, and for no likeness, in minima.
    off = torch.where(there & (off < tolerance), off, torch.full_like(off, 1.0e9))
    nothing = torch.full((depth_m.shape[0], height * width), 1.0e9, device=depth_m.device)
    least = nothing.scatter_reduce(1, index, off, "amin")
    # Of two that are equally like it the nearer one, whatever their order.
    best = (off < 1.0e9) & (off <= torch.gather(least, 1, index))
    found = nothing.scatter_reduce(1, index, torch.where(best, returned, torch.full_like(off, 1.0e9)), "amin")
    return torch.where(found < 1.0e9, found, torch.full_like(found, float("nan"))).reshape(-1, 1, height, width)
