"""Mix of the network's depth with geometry's, in the logarithm, and the confidence of the result."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.baff.sky import WIDTHS
from radcam_depth_ros.networks.layers.blocks import LEAK, PlanarConv, Projection
from radcam_depth_ros.networks.layers.image_statistics import ImageStatistics
from radcam_depth_ros.networks.layers.number_formats import InFloat32

WIDTH = 32
"""Channels of the mix's features."""

PLANES = 10
"""Planes that it sees besides features."""

TYPICAL = (0.44, 0.16, -4.14, -4.02, -3.69, 0.05, 0.06, 0.13, -2.37, 3.76)
SCALES = (4.67, 11.0, 0.86, 1.35, 1.44, 5.1, 6.8, 6.0, 0.83, 0.62)
"""Of simulated pictures: means of `ImageStatistics` and of log(1 + returns), and the inverse of their deviations."""

EMPHASIS = 10.0
"""Differences of planes are small beside 1: a tenth of the depth is 0.02."""


class GeometryMix(nn.Module):
    """Weighs two experts for each pixel: the network, and the flat road as told or the nearest return.

    The weight goes both ways: geometry may be nearer or farther. It depends on features, on the network's own
    confidence, on where the road is seen and where it is told, on how near a return is, and on the statistics of the
    whole picture. This module is not in the paper.

    Args:
        channels: Of the features of stage 2 at 1/4.
        detail: Parts of a pixel along each axis, for each of which there is a weight.
    """

    emphasis: Final[float] = EMPHASIS

    def __init__(self, channels: int, detail: int) -> None:
        super().__init__()
        self.detail = detail
        self.activation = nn.LeakyReLU(LEAK)
        # A convolution and its norm, which become one for inference.
        self.join = Projection(channels + PLANES + WIDTHS[2], WIDTH, 3)
        self.measure = ImageStatistics()
        self.statistics = _Statistics(WIDTH)
        bias = torch.zeros(2 * detail * detail)
        bias[: detail * detail] = -1.0
        self.head = PlanarConv(WIDTH, bias)

    def forward(
        self,
        image: Tensor,
        returns: Tensor,
        features: Tensor,
        sky_features: Tensor,
        planes: Tensor,
        depth: Tensor,
        geometry: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Mixes.

        Args:
            image: (B, 3, H, W).
            returns: (B, 1), how many radar returns there are.
            features: (B, channels, h, w) of stage 2 at 1/4.
            sky_features: (B, 24, h, w) of the sky.
            planes: (B, PLANES - 3, h, w) float32: what is known of the returns and the road, see `Baff`.
            depth: (B, 1, h detail, w detail), the plane of the network's own depth.
            geometry: (B, 1, h detail, w detail), that of geometry's.

        Returns:
            The plane of the mix and the logit of its confidence, both (B, 1, h detail, w detail) float32.
        """
        depth, geometry = depth.float(), geometry.float()
        apart = self.emphasis * functional.avg_pool2d(geometry - depth, self.detail)
        known = torch.cat([planes, apart, apart.abs(), functional.avg_pool2d(depth, self.detail)], dim=1)
        known = known.to(features.dtype)
        whole = self.statistics(torch.cat([self.measure(image), torch.log1p(returns.float())], dim=1))
        x = self.join(torch.cat([features, known, sky_features.to(features.dtype)], dim=1))
        x = self.activation(x + whole.to(x.dtype).unsqueeze(2).unsqueeze(3))
        parts = self.detail * self.detail
        raw = self.head(x)
        weight = torch.sigmoid(functional.pixel_shuffle(raw[:, :parts], self.detail))
        confidence_logit = functional.pixel_shuffle(raw[:, parts:], self.detail)
        return depth + weight * (geometry - depth), confidence_logit


class _Statistics(InFloat32):
    """What a picture's statistics add to all of its pixels: two linear layers, in float32.

    Statistics are scaled by constants, so that a batch of one picture trains as well as a large one.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(TYPICAL))
        self.register_buffer("scale", torch.tensor(SCALES))
        self.layers = nn.Sequential(Float32Linear(len(TYPICAL), 16), nn.LeakyReLU(LEAK), Float32Linear(16, width))

    def compute(self, x: Tensor) -> Tensor:
        result: Tensor = self.layers((x - self.mean) * self.scale)
        return result


class Float32Linear(nn.Linear):
    """Linear layer whose weights stay in float32."""

    keeps_float32 = True
