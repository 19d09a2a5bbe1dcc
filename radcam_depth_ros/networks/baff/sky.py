"""Sky of a picture, as a logit at half of its size."""

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import LEAK, ConvBlock, PlanarConv, Projection, UpSum, double

WIDTH = 24
"""Channels at 1/4."""

COARSE, MIDDLE = 48, 32
"""Channels at 1/16 and at 1/8."""

PLANES = 3
"""Planes that it sees besides features: the road, the network's own depth, and its confidence."""

FINE = 8
"""Channels at 1/2: what is thin against the sky is decided there."""


class SkyHead(nn.Module):
    """Tells the sky from features of both stages, with a light stem at 1/2 for thin things. Not in the paper.

    The image's encoder, from 1/32 to 1/8, tells what is sky as a whole. At 1/4 it is told how likely the sky is, and
    what each channel of the stem says about it there: a dark line is a wire before a bright sky, and nothing on a wall.

    Args:
        channels: Of the image encoder's maps at 1/4, 1/8, 1/16, 1/32; stage 2's features have those at 1/4.
    """

    def __init__(self, channels: tuple[int, int, int, int]) -> None:
        super().__init__()
        self.activation = nn.LeakyReLU(LEAK)
        self.coarse = UpSum(channels[3], channels[2], COARSE)
        self.middle = UpSum(COARSE, channels[1], MIDDLE)
        self.around = Projection(MIDDLE, WIDTH)
        self.here = Projection(channels[0] + PLANES, WIDTH)
        bias = torch.zeros(1 + FINE)
        bias[0] = -1.0
        self.gates = PlanarConv(WIDTH, bias)
        self.stem = ConvBlock(3, FINE, stride=2)

    def forward(self, image: Tensor, maps: list[Tensor], features: Tensor, planes: Tensor) -> Tensor:
        """Tells the sky.

        Args:
            image: (B, 3, H, W).
            maps: Of the image encoder.
            features: (B, channels, H / 4, W / 4) of stage 2.
            planes: (B, PLANES, H / 4, W / 4) float32.

        Returns:
            The logit (B, 1, H / 2, W / 2) float32.
        """
        around = self.around(self.middle(self.coarse(maps[3], maps[2]), maps[1]))
        planes = planes.to(features.dtype).contiguous(memory_format=torch.channels_last)  # as the features are
        here = self.here(torch.cat([features, planes], dim=1))
        gates = double(self.gates(self.activation(here.add_(double(around)))))
        fine = (gates[:, 1:] * self.stem(image).float()).sum(dim=1, keepdim=True)
        logit: Tensor = gates[:, :1] + fine
        return logit
