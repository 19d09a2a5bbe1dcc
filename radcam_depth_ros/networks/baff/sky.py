"""Sky of a picture, as a logit at half of its size."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import ConvBlock, PlanarConv, double

WIDTH = 24
"""Channels at 1/4."""

FINE = 8
"""Channels at 1/2: what is thin against the sky is decided there."""


class SkyHead(nn.Module):
    """Tells the sky from stage 2's features, with a light stem at 1/2 for what is thin against it. Not in the paper.

    At 1/4 it is told how likely the sky is, and what each channel of the stem says about it there: a dark line is a
    wire before a bright sky, and nothing on a wall.

    Args:
        channels: Of stage 2's features.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.features = ConvBlock(channels, WIDTH, 1)
        bias = torch.zeros(1 + FINE)
        bias[0] = -1.0
        self.gates = PlanarConv(WIDTH, bias)
        self.stem = ConvBlock(3, FINE, stride=2)

    def forward(self, image: Tensor, features: Tensor) -> Tensor:
        """Takes (B, 3, H, W) and (B, channels, H / 4, W / 4) to the logit (B, 1, H / 2, W / 2) float32."""
        gates = double(self.gates(self.features(features)))
        fine = (gates[:, 1:] * self.stem(image).float()).sum(dim=1, keepdim=True)
        logit: Tensor = gates[:, :1] + fine
        return logit
