"""Detail of stage 2 at half the image's size, and the way from there to the whole."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import (
    LEAK,
    ConvBlock,
    PlanarConv,
    Projection,
    RoundedPlanarConv,
    double,
)

WIDTH = 24
"""Channels at 1/2."""

STRIPS = 4
"""Parts of a picture, one above the other, that are looked at one by one where nothing learns.

Maps at 1/2 are the largest of the network. In parts they stay in the processor's cache.
"""

MOST = 30.0
"""Largest logit of a weight, either way: within it no sum of exponentials overflows."""

BILINEAR = (9.0, 3.0, 3.0, 1.0)
"""Sixteenths of the nearest pixel, the next one in the column, in the row, and across, in bilinear interpolation."""


class Detail(nn.Module):
    """Corrects the head's choice where the image shows edges, and tells how its depth becomes that of the whole image.

    Stage 2 works at a quarter of the image's size. Features of the image at half of it, of a light stem, join its own
    here. Both results are such before training that the depth is the head's, enlarged bilinearly. Not in the paper; the
    weights of pixels around are as in [Teed2020], of four pixels in place of nine.

    Args:
        channels: Of stage 2's features at 1/4.
        values: What is corrected.
    """

    def __init__(self, channels: int, values: int) -> None:
        super().__init__()
        self.stem = ConvBlock(3, WIDTH, kernel=5, stride=2)
        self.reduce = Projection(channels, WIDTH)
        self.activation = nn.LeakyReLU(LEAK, inplace=True)
        self.conv = ConvBlock(WIDTH, WIDTH)
        self.correct = PlanarConv(WIDTH, torch.zeros(values))
        self.strips, self.most = STRIPS, MOST
        # For each of the four parts of a pixel.
        self.weigh = RoundedPlanarConv(WIDTH, torch.log(torch.tensor(BILINEAR)).repeat(4))

    def forward(self, image: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Looks at the image.

        Args:
            image: (B, 3, H, W).
            features: (B, channels, H / 4, W / 4) of stage 2.

        Returns:
            What is added to the head's values, (B, values, H / 2, W / 2), and logits of weights (B, 16, H / 2, W / 2),
            as `enlarged` takes them; both float32.
        """
        if self.training:
            return self._look(image, features)
        rows = features.shape[2]
        corrections: list[Tensor] = []
        weights: list[Tensor] = []
        for index in range(self.strips):
            first, end = rows * index // self.strips, rows * (index + 1) // self.strips
            # A row more on either side: what is made of padding there is left out.
            top, bottom = first - int(index > 0), end + int(index < self.strips - 1)
            strip = self._look(image[:, :, 4 * top : 4 * bottom], features[:, :, top:bottom])
            corrections.append(strip[0][:, :, 2 * (first - top) : 2 * (end - top)])
            weights.append(strip[1][:, :, 2 * (first - top) : 2 * (end - top)])
        return torch.cat(corrections, dim=2), torch.cat(weights, dim=2)

    def _look(self, image: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        x = self.conv(self.activation(double(self.reduce(features)).add_(self.stem(image))))
        return self.correct(x), self.weigh(x).clamp(-self.most, self.most)


def enlarged(plane: Tensor, logits: Tensor) -> Tensor:
    """Doubles the size: each part of a pixel is a mean of the four pixels that are nearest to it.

    Args:
        plane: (B, 1, h, w) float32.
        logits: (B, 16, h, w) float32: for each part of a pixel, row by row, the logits of the weights of the pixel, of
            the next one in the column, in the row, and across; none beyond `MOST`.

    Returns:
        (B, 1, 2 h, 2 w) float32.
    """
    rows, columns = plane.shape[2], plane.shape[3]
    around = functional.pad(plane, (1, 1, 1, 1), mode="replicate")
    above, level, below = around[:, :, :rows], around[:, :, 1 : 1 + rows], around[:, :, 2:]
    beside = _beside(level, columns)
    weights = torch.exp(logits)
    halves = [
        _half(weights[:, :8], plane, above[:, :, :, 1 : 1 + columns], beside, _beside(above, columns)),
        _half(weights[:, 8:], plane, below[:, :, :, 1 : 1 + columns], beside, _beside(below, columns)),
    ]
    return functional.pixel_shuffle(torch.cat(halves, dim=1), 2)


def _beside(around: Tensor, columns: int) -> Tensor:
    """The next pixels on the left and on the right, (B, 2, h, columns), of (B, 1, h, columns + 2)."""
    return torch.cat([around[:, :, :, :columns], around[:, :, :, 2:]], dim=1)


def _half(weights: Tensor, here: Tensor, next_row: Tensor, beside: Tensor, across: Tensor) -> Tensor:
    """The left and the right part (B, 2, h, w) of the upper or the lower row of parts, of weights (B, 8, h, w)."""
    of_here, of_row, of_beside, of_across = weights[:, ::4], weights[:, 1::4], weights[:, 2::4], weights[:, 3::4]
    mean = torch.addcmul(of_here * here, of_row, next_row)
    mean = torch.addcmul(torch.addcmul(mean, of_beside, beside), of_across, across)
    return mean / (of_here + of_row + of_beside + of_across)
