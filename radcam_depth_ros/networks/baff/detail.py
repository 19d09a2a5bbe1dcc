"""Detail of stage 2 at half the image's size, and the way from there to the whole."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import LEAK, ConvBlock, PlanarConv, Projection, double

WIDTH = 24
"""Channels at 1/2."""

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
        self.stem = ConvBlock(3, WIDTH, kernel=5, stride=2, raw=True)
        self.reduce = Projection(channels, WIDTH)
        self.activation = nn.LeakyReLU(LEAK, inplace=True)
        self.conv = ConvBlock(WIDTH, WIDTH)
        self.correct = PlanarConv(WIDTH, torch.zeros(values))
        # For each of the four parts of a pixel.
        self.weigh = PlanarConv(WIDTH, torch.log(torch.tensor(BILINEAR)).repeat(4))

    def forward(self, image: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Looks at the image.

        Args:
            image: (B, 3, H, W).
            features: (B, channels, H / 4, W / 4) of stage 2.

        Returns:
            What is added to the head's values, (B, values, H / 2, W / 2), and logits of weights (B, 16, H / 2, W / 2),
            as `enlarged` takes them; both float32.
        """
        # To float32 once, not in each of the two.
        x = self.conv(self.activation(double(self.reduce(features)).add_(self.stem(image)))).float()
        return self.correct(x), self.weigh(x)


def enlarged(plane: Tensor, logits: Tensor) -> Tensor:
    """Doubles the size: each part of a pixel is a mean of the four pixels that are nearest to it.

    Args:
        plane: (B, 1, h, w) float32.
        logits: (B, 16, h, w) float32: for each part of a pixel, row by row, the logits of the weights of the pixel, of
            the next one in the column, in the row, and across.

    Returns:
        (B, 1, 2 h, 2 w) float32.
    """
    around = functional.pad(plane, (1, 1, 1, 1), mode="replicate")
    upper, lower = logits[:, :8], logits[:, 8:]
    parts = [
        _part(around, upper[:, :4], 0, 0),
        _part(around, upper[:, 4:], 0, 2),
        _part(around, lower[:, :4], 2, 0),
        _part(around, lower[:, 4:], 2, 2),
    ]
    return functional.pixel_shuffle(torch.cat(parts, dim=1), 2)


def _part(around: Tensor, logits: Tensor, down: int, right: int) -> Tensor:
    """One part (B, 1, h, w) of all pixels, of a plane (B, 1, h + 2, w + 2) with a margin; `down`, `right`: 0 or 2."""
    rows, columns = logits.shape[2], logits.shape[3]
    near = torch.cat(
        [
            around[:, :, 1 : 1 + rows, 1 : 1 + columns],
            around[:, :, down : down + rows, 1 : 1 + columns],
            around[:, :, 1 : 1 + rows, right : right + columns],
            around[:, :, down : down + rows, right : right + columns],
        ],
        dim=1,
    )
    return (torch.softmax(logits, dim=1) * near).sum(dim=1, keepdim=True)
