"""Sky of a picture, as a logit at half of its size."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import LEAK, ConvBlock, HereAndAround, PlanarConv, double

WIDTH = 24
"""Channels at 1/4."""

PLANES = 3
"""Planes that it sees besides features: the road, the network's own depth, and its confidence."""

FINE = 8
"""Channels at 1/2: what is thin against the sky is decided there."""


class SkyHead(nn.Module):
    """Tells the sky from stage 2's features, with a light stem at 1/2 for what is thin against it. Not in the paper.

    At 1/4 it is told how likely the sky is, and what each channel of the stem says about it there: a dark line is a
    wire before a bright sky, and nothing on a wall. What is around a pixel is seen at 1/8.

    Args:
        channels: Of stage 2's features.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.activation = nn.LeakyReLU(LEAK)
        self.look = HereAndAround(channels + PLANES, WIDTH)
        bias = torch.zeros(1 + FINE)
        bias[0] = -1.0
        self.gates = PlanarConv(WIDTH, bias)
        self.stem = ConvBlock(3, FINE, stride=2)

    def forward(self, image: Tensor, features: Tensor, planes: Tensor) -> Tensor:
        """Tells the sky.

        Args:
            image: (B, 3, H, W).
            features: (B, channels, H / 4, W / 4).
            planes: (B, PLANES, H / 4, W / 4) float32.

        Returns:
            The logit (B, 1, H / 2, W / 2) float32.
        """
        seen = torch.cat([features, planes.to(features.dtype)], dim=1)
        gates = double(self.gates(self.activation(self.look(seen))))
        fine = (gates[:, 1:] * self.stem(image).float()).sum(dim=1, keepdim=True)
        logit: Tensor = gates[:, :1] + fine
        return logit
