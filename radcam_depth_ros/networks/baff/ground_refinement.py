"""Corrects the flat road's plane by votes of each part of the image.

How a camera hangs above the road is known roughly at best: vehicles pitch and roll, roads rise and bank, and many
drives do not tell the camera's height. A wrong road is wrong everywhere: half a degree is a tenth of the depth at 15 m.
"""

from typing import Final

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.layers.blocks import ConvBlock, PlanarConv, UpSum

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

    def forward(self, maps: list[Tensor], ground: Tensor) -> Tensor:
        """Takes the encoder's maps and (B, 4) a, b, c, whether known, to the same with a, b, c corrected."""
        votes = self.votes(self.features(self.up(maps[3], maps[2])))
        batch, rows, columns = votes.shape[0], votes.shape[2], votes.shape[3]
        x = self._places(columns, votes.device).reshape(1, 1, -1).expand(1, rows, -1)
        y = self._places(rows, votes.device).reshape(1, -1, 1).expand(1, -1, columns)
        places = torch.stack([x, y, torch.ones_like(x)], dim=-1).reshape(1, -1, 3)
        weight = torch.sigmoid(votes[:, 1]).reshape(batch, -1, 1) / 16.0
        weighted = places * weight
        trust = torch.exp(torch.where(ground[:, 3:] > 0.5, self.trust[1], self.trust[0]))
        # Products and sums, not matrix products: autocast would make those bfloat16.
        matrix = (weighted.unsqueeze(3) * places.unsqueeze(2)).sum(dim=1) + torch.diag_embed(trust)
        x, y, z = self._solve(matrix, (weighted * votes[:, 0].reshape(batch, -1, 1)).sum(dim=1))
        # NaN, where nothing is told, would make the gradient NaN, too.
        step = self.vote_rows * torch.nan_to_num(ground[:, 1])
        middle_x, middle_y = 8.0 * columns - 0.5, 8.0 * rows - 0.5
        x, y = step * x / self.span_px, step * y / self.span_px
        z = step * z - x * middle_x - y * middle_y
        return torch.cat([ground[:, :3] + torch.stack([x, y, z], dim=1), ground[:, 3:]], dim=1)

    def _places(self, count: int, device: torch.device) -> Tensor:
        """Where pixels at 1/16 are along an axis, from the image's middle, in spans."""
        return (torch.arange(count, device=device, dtype=torch.float32) + 0.5 - 0.5 * count) * 16.0 / self.span_px

    def _solve(self, matrix: Tensor, right: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Cramer's rule: a solver that checks its result would wait for the device. (B, 3, 3), (B, 3) to three (B,)."""
        first, second, third = matrix[:, :, 0], matrix[:, :, 1], matrix[:, :, 2]
        whole = _volume(first, second, third)
        return (
            _volume(right, second, third) / whole,
            _volume(first, right, third) / whole,
            _volume(first, second, right) / whole,
        )


def _volume(first: Tensor, second: Tensor, third: Tensor) -> Tensor:
    volume: Tensor = (first * torch.linalg.cross(second, third, dim=1)).sum(dim=1)
    return volume
