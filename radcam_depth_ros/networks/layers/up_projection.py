"""Up-projection ([Laina2016]): decoders that double a map's size with residual blocks."""

from itertools import pairwise

from torch import Tensor, nn

from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d

LEVELS = 4
"""Up-projections of a decoder: from 1/32 of the image's size to 1/2."""


class UpProjection(nn.Module):
    """Doubles the size: a map is unpooled, and two branches of it are summed ([Li2023], figure 8).

    Unpooling puts each value into the upper left of 2 x 2 pixels with zeros beside. A 5x5 convolution of that is a
    transposed one of the map before, which leaves out the products with zeros: a quarter of the work. That of both
    branches is one convolution here.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.unpooled = nn.Sequential(
            nn.ConvTranspose2d(in_channels, 2 * out_channels, 5, 2, 2, output_padding=1, bias=False),
            nn.BatchNorm2d(2 * out_channels),
        )
        self.upper = nn.Sequential(
            nn.ReLU(), nn.Conv2d(out_channels, out_channels, 3, 1, 1, bias=False), nn.BatchNorm2d(out_channels)
        )
        self.activation = nn.ReLU()

    def forward(self, x: Tensor) -> Tensor:
        upper, lower = self.unpooled(x).chunk(2, dim=1)
        result: Tensor = self.activation(self.upper(upper) + lower)
        return result


class UpDecoder(nn.Module):
    """Four up-projections, each with half the channels of the one before, and a 3x3 convolution.

    Args:
        in_channels: Of the map at 1/32.
        out_channels: Of the result.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        widths = [in_channels >> level for level in range(LEVELS + 1)]
        self.levels = nn.Sequential(*(UpProjection(wide, narrow) for wide, narrow in pairwise(widths)))
        self.head = Float32Conv2d(widths[-1], out_channels, 3, 1, 1)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Takes the map at 1/32 to the features at 1/2 and the result there."""
        features = self.levels(x)
        return features, self.head(features)
