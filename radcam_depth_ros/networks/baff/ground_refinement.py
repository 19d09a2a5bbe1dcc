"""Corrects the flat road's plane by votes of each part of the image.

How a camera hangs above the road is known roughly at best: vehicles pitch and roll, roads rise and bank, and many
drives do not tell the camera's height. A wrong road is wrong everywhere: half a degree is a tenth of the depth at 15 m.
"""

from typing import Final

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import ConvBlock, PlanarConv, UpSum
from radcam_depth_ros.networks.layers.image_statistics import FromStatistics

FEATURES = 64
"""Channels of the votes' features."""

VOTE_ROWS = 16.0
"""A vote of 1 moves the road by so many rows of the image."""

SPAN_PX = 256.0
"""Pixels that are 1 in the equations, so that all of their entries are of one size."""


class RoadVotes(nn.Module):
    """Corrects the flat road's inverse depth a u + b v + c.

    It is linear in the pixel whatever the camera's attitude. Each pixel at 1/16 votes for how many rows the road is off
    there, and says how much its vote counts. A plane through the votes, by weighted least squares, is added to the one
    that is told. What is told counts as well, by learned weights: more where it is known than where it is assumed. This
    module is not in the paper. From the votes on all is float32: half a degree is a tenth of the depth at 15 m.

    Args:
        channels: Of the encoder's maps at 1/4, 1/8, 1/16, 1/32.
    """

    keeps_float32 = True  # the trust
    vote_rows: Final[float] = VOTE_ROWS
    span_px: Final[float] = SPAN_PX

    def __init__(self, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.up = UpSum(channels[3], channels[2], FEATURES)
        self.features = ConvBlock(FEATURES, FEATURES)
        # No vote at first.
        self.votes = PlanarConv(FEATURES, torch.zeros(2))
        # Logarithms of what is told, of the three coefficients; first where it is assumed, then where it is known.
        self.trust = nn.Parameter(torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]))

    def forward(self, maps: list[Tensor], ground: Tensor, heard: Tensor) -> tuple[Tensor, Tensor]:
        """Corrects the road.

        Args:
            maps: Of the encoder.
            ground: (B, 4) a, b, c, and whether known.
            heard: (B, 1) float32, 0 to 1, how much of the correction is made, see `RoadDoubt`.

        Returns:
            The same with a, b, c corrected, and the covariance (B, 3, 3) of the correction, as `deviation` takes it: of
            height, pitch and roll in one, for votes of deviation 1; it passes no gradient to `heard`.
        """
        votes = self.votes(self.features(self.up(maps[3], maps[2])))
        batch, rows, columns = votes.shape[0], votes.shape[2], votes.shape[3]
        x = self._places(columns, votes.device).reshape(1, 1, -1).expand(1, rows, -1)
        y = self._places(rows, votes.device).reshape(1, -1, 1).expand(1, -1, columns)
        places = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(1, -1, 3)
        weight = torch.sigmoid(votes[:, 1]).reshape(batch, -1, 1) / 16.0
        weighted = places * weight
        trust = torch.exp(torch.where(ground[:, 3:] > 0.5, self.trust[1], self.trust[0]))
        # Products and sums, not matrix products: autocast would make those bfloat16.
        inverse = _inverse((weighted.unsqueeze(3) * places.unsqueeze(2)).sum(dim=1) + torch.diag_embed(trust))
        right = (weighted * votes[:, 0].reshape(batch, -1, 1)).sum(dim=1)
        x, y, z = (inverse * right.unsqueeze(1)).sum(dim=2).unbind(1)
        # NaN, where nothing is told, would make the gradient NaN, too.
        step = heard[:, 0] * self.vote_rows * torch.nan_to_num(ground[:, 1])
        middle_x, middle_y = 8.0 * columns - 0.5, 8.0 * rows - 0.5
        x, y = step * x / self.span_px, step * y / self.span_px
        z = step * z - x * middle_x - y * middle_y
        certain = heard.detach().unsqueeze(2)
        covariance = certain * inverse + (1.0 - certain) * torch.diag_embed(1.0 / trust)
        return torch.cat([ground[:, :3] + torch.stack([x, y, z], dim=1), ground[:, 3:]], dim=1), covariance

    @torch.jit.export
    def deviation(self, covariance: Tensor, ground: Tensor, road_m: Tensor, stride: float) -> Tensor:
        """Standard deviation of the logarithm of the road's depth.

        Args:
            covariance: (B, 3, 3) float32, of the correction.
            ground: (B, 4), the road that was told.
            road_m: (B, 1, h, w) float32, the depth of the corrected road in metres.
            stride: Pixels of the image a pixel of `road_m`.

        Returns:
            (B, 1, h, w) float32, at most 1; 0 where nothing is told.
        """
        x = self._places(road_m.shape[3], road_m.device, stride).reshape(1, 1, 1, -1)
        y = self._places(road_m.shape[2], road_m.device, stride).reshape(1, 1, -1, 1)
        c = covariance.reshape(-1, 9, 1, 1, 1).unbind(1)
        variance = c[0] * x * x + c[4] * y * y + c[8] + 2.0 * (c[1] * x * y + c[2] * x + c[5] * y)
        step = self.vote_rows * torch.nan_to_num(ground[:, 1]).abs().reshape(-1, 1, 1, 1)
        return (step * variance.clamp(min=1e-12).sqrt() * road_m).clamp(max=1.0)

    def _places(self, count: int, device: torch.device, stride: float = 16.0) -> Tensor:
        """Where pixels of `stride` are along an axis, from the image's middle, in spans."""
        return (torch.arange(count, device=device, dtype=torch.float32) + 0.5 - 0.5 * count) * stride / self.span_px


class RoadDoubt(nn.Module):
    """How much of the votes' correction is made, and how uncertain it leaves the road: a part that learns by itself.

    Votes abstain on frames whose statistics say that the picture tells nothing.
    """

    keeps_float32 = True  # the spread

    def __init__(self) -> None:
        super().__init__()
        self.gate = FromStatistics(torch.full((1,), 1.0))
        # Logarithm of a vote's standard deviation, were it the only one.
        self.spread = nn.Parameter(torch.full((1,), -1.0))

    def forward(self, statistics: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 10), as `FrameStatistics` has them, to what `RoadVotes` takes (B, 1), and a vote's variance (1,)."""
        return torch.sigmoid(self.gate(statistics)), torch.exp(2.0 * self.spread)


def _inverse(matrix: Tensor) -> Tensor:
    """(B, 3, 3) to its inverse by cross products: a solver that checks its result would wait for the device."""
    first, second, third = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    adjugate = torch.stack(
        [
            torch.linalg.cross(second, third, dim=1),
            torch.linalg.cross(third, first, dim=1),
            torch.linalg.cross(first, second, dim=1),
        ],
        dim=2,
    )
    whole = (first * adjugate[:, :, 0]).sum(dim=1)
    return adjugate / whole.reshape(-1, 1, 1)
