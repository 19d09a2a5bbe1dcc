"""Mix of the network's depth with geometry's, in the logarithm, and the confidence of the result."""

from typing import Final

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.layers.blocks import LEAK, HereAndAround, PlanarConv
from radcam_depth_ros.networks.layers.image_statistics import FromStatistics

WIDTH = 24
"""Channels of the mix's features."""

PLANES = 11
"""Planes that it sees besides features."""

EMPHASIS = 10.0
"""Differences of planes are small beside 1: a tenth of the depth is 0.02."""


class GeometryMix(nn.Module):
    """Weighs experts for each pixel: the network, and the flat road or the nearest return, whichever is nearer.

    There is geometry on the road as told, and on the road that is used; they differ where the road is assumed alone.
    Weights go both ways: geometry may be nearer or farther. They depend on features, on the network's own confidence,
    on where the road is seen, told and how uncertain it is, on how near a return is, and on the statistics of the whole
    frame. This module is not in the paper.

    Args:
        channels: Of the features of stage 2 at 1/4.
        detail: Parts of a pixel along each axis, for each of which there is a weight.
    """

    emphasis: Final[float] = EMPHASIS

    def __init__(self, channels: int, detail: int) -> None:
        super().__init__()
        self.detail = detail
        self.activation = nn.LeakyReLU(LEAK)
        self.look = HereAndAround(channels + PLANES, WIDTH)
        self.whole = FromStatistics(torch.zeros(WIDTH))
        # Weights of geometry, twice, for the parts of a pixel; what their confidence changes by; factor of the
        # network's own.
        parts = detail * detail
        bias = torch.cat([torch.full((2 * parts,), -2.5), torch.zeros(parts), torch.ones(1)])
        self.head = PlanarConv(WIDTH, bias)

    def forward(
        self,
        statistics: Tensor,
        features: Tensor,
        planes: Tensor,
        depth: Tensor,
        confidence_logit: Tensor,
        told: Tensor,
        used: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Mixes.

        Args:
            statistics: (B, 10) float32, as `FrameStatistics` has them.
            features: (B, channels, h, w) of stage 2 at 1/4.
            planes: (B, PLANES - 3, h, w) float32: what is known of the returns and the road, see `Baff`.
            depth: (B, 1, h detail, w detail), the plane of the network's own depth.
            confidence_logit: The same size, of its confidence.
            told: The same size, the plane of geometry's depth on the road as told.
            used: The same on the road that is used.

        Returns:
            The plane of the mix and the logit of its confidence, both (B, 1, h detail, w detail) float32.
        """
        depth, told, used = depth.float(), told.float(), used.float()
        apart = self.emphasis * functional.avg_pool2d(used - depth, self.detail)
        known = torch.cat([planes, apart, apart.abs(), functional.avg_pool2d(depth, self.detail)], dim=1)
        known = known.to(features.dtype).contiguous(memory_format=torch.channels_last)  # as the features are
        x = self.look(torch.cat([features, known], dim=1))
        x = self.activation(x + self.whole(statistics).to(x.dtype).unsqueeze(2).unsqueeze(3))
        parts = self.detail * self.detail
        raw = self.head(x)
        logits = functional.pixel_shuffle(raw[:, : 3 * parts], self.detail)
        weights = torch.softmax(torch.cat([torch.zeros_like(depth), logits[:, :2]], dim=1), dim=1)
        factor = functional.interpolate(raw[:, 3 * parts :], scale_factor=float(self.detail))
        mixed = weights[:, :1] * depth + weights[:, 1:2] * told + weights[:, 2:] * used
        return mixed, logits[:, 2:] + factor * confidence_logit.float()
