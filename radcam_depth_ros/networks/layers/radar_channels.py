"""Radar returns as an image of several channels, for networks that convolve them like an image."""

import torch
from torch import Tensor

from radcam_depth_ros.networks.layers.rasterise import draw_nearest, pixels

PLANES = 4
"""Channels of `draw_planes`."""


def draw_planes(radar: Tensor, valid: Tensor, height: int, width: int, max_depth_m: float) -> Tensor:
    """Draws returns at their pixels, the nearest where several meet.

    The published systems take depth, RCS and a velocity of two components. A radial speed is what every radar gives,
    and one that lacks it or the RCS must say so: the fourth channel is the share of both that was measured.

    Depth is linear and not its logarithm, so that 0 is only where there is no return: these networks convolve it
    without a mask and give their result as a share of the greatest depth as well.

    Args:
        radar: (B, N, 6), columns as `RADAR_COLUMNS`; N may be 0.
        valid: (B, N) bool.
        height: Rows of the image.
        width: Columns of the image.
        max_depth_m: The depth that is drawn as 1; what is farther is drawn there, too.

    Returns:
        (B, 4, height, width) float32: depth, RCS in 20 dBsm, radial speed in 20 m/s, both limited and 0 where unknown,
        and how much of these two is known, 0 to 1. All 0 where there is no return.
    """
    depth_m = draw_nearest(radar, valid, height, width, 1)
    place, inside = pixels(radar, valid, height, width, 1)
    wins = inside & (radar[:, :, 2].float() <= torch.gather(depth_m.flatten(1), 1, place))
    rcs, speed = radar[:, :, 3].float(), radar[:, :, 4].float()
    known = 0.5 * (torch.isfinite(rcs).float() + torch.isfinite(speed).float())
    # Some radars give a level above their noise in place of a cross section: up to 100 dB.
    rcs = (_finite(rcs) / 20.0).clamp(-3.0, 5.0)
    speed = (_finite(speed) / 20.0).clamp(-3.0, 3.0)
    planes = [(depth_m / max_depth_m).clamp(max=1.0)]
    for values in (rcs, speed, known):
        lowest = torch.full((radar.shape[0], height * width), -10.0, device=radar.device)
        # Returns of one depth in one pixel: the greater value of each, whatever their order.
        drawn = lowest.scatter_reduce(1, place, torch.where(wins, values, torch.full_like(values, -10.0)), "amax")
        planes.append(torch.where(drawn > -10.0, drawn, torch.zeros_like(drawn)).reshape(-1, 1, height, width))
    return torch.cat(planes, dim=1)


def _finite(values: Tensor) -> Tensor:
    return torch.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
