"""Sky of a picture, as a logit at half of its size."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import LEAK, ConvBlock, PlanarConv, Projection, double

WIDTHS = (48, 32, 24)
"""Channels at 1/32 and 1/16, at 1/8, and at 1/4."""

FINE = 8
"""Channels at 1/2: what is thin against the sky is decided there."""


class SkyHead(nn.Module):
    """Decodes the image encoder's maps to the sky, with a light stem at 1/2 for what is thin. Not in the paper.

    Args:
        channels: Of the image encoder's maps at 1/4, 1/8, 1/16, 1/32.
    """

    def __init__(self, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.activation = nn.LeakyReLU(LEAK)
        self.coarse = Projection(channels[3], WIDTHS[0])
        self.laterals = nn.ModuleList(
            Projection(before, after) for before, after in zip(reversed(channels[:3]), WIDTHS, strict=True)
        )
        self.joins = nn.ModuleList(
            ConvBlock(before, after) for before, after in zip(WIDTHS, (*WIDTHS[1:], WIDTHS[2]), strict=True)
        )
        self.look = Projection(3, WIDTHS[2], 3)
        self.stem = ConvBlock(3, FINE, stride=2)
        self.narrow = Projection(WIDTHS[2], FINE)
        self.last = ConvBlock(2 * FINE, FINE)
        self.logit = PlanarConv(FINE, torch.tensor([-1.0]))

    def forward(self, image: Tensor, maps: list[Tensor], road: Tensor) -> tuple[Tensor, Tensor]:
        """Finds the sky.

        Args:
            image: (B, 3, H, W).
            maps: Of the image encoder, finest first.
            road: (B, 1, H / 4, W / 4), the flat road's plane, which ends at the horizon.

        Returns:
            The logit (B, 1, H / 2, W / 2) float32, and features (B, 24, H / 4, W / 4).
        """
        small = functional.avg_pool2d(image, 4)
        spread = small.amax(dim=1, keepdim=True) - small.amin(dim=1, keepdim=True)
        look = self.look(torch.cat([small.mean(dim=1, keepdim=True), spread, road.to(small.dtype)], dim=1))
        x = self.coarse(maps[3])
        for index, (lateral, join) in enumerate(zip(self.laterals, self.joins, strict=False)):
            x = double(x) + lateral(maps[2 - index])
            if index == 2:
                x = x + look
            x = join(self.activation(x))
        fine = self.last(torch.cat([double(self.narrow(x)), self.stem(image)], dim=1))
        return self.logit(fine), x
