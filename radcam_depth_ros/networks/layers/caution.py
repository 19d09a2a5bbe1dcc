"""Blends depth of low confidence with geometry where geometry is nearer.

Not in the papers. In doubt, what is near matters more than what is behind it, and on pictures unlike those that it was
trained on a network doubts often (docs/results.md). On a picture like those a doubtful depth is still the best guess,
and nothing moves: such a picture is known by the share of its pixels that the network is sure of. Losses see the depth
without.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.config import ArchitectureError
from radcam_depth_ros.networks.layers.rasterise import Rasterise, depth_to_plane, plane_to_depth

LEAN = 0.8
"""How far, at most, a doubtful depth goes towards the nearest return's or the road's: a share of the logarithm."""

DOUBT_SPAN = 0.3
"""So far below `caution` the confidence has to be for that."""

UNSURE, SURE = 0.6, 0.8
"""Confidence from which on a pixel begins to count as sure, and counts wholly."""

STRANGE = 2 / 3
"""The share of sure pixels, relative to `familiar`, below which a picture is wholly strange."""

RETURNS_PER_CELL = 8
"""Returns that each cell of 32 x 32 pixels looks up."""


def check_caution(caution: float, familiar: float) -> None:
    """Refuses what is no probability or no share, by an ArchitectureError."""
    if not 0 <= caution <= 1:
        raise ArchitectureError(f"caution must lie between 0 and 1, got {caution}")
    if not 0 <= familiar <= 1:
        raise ArchitectureError(f"familiar must lie between 0 and 1, got {familiar}")


class Caution(nn.Module):
    """Moves doubtful depths.

    Args:
        caution: The confidence below which a depth is doubtful; 0: none is.
        familiar: The share of sure pixels from which on depths of a picture stay as they are; 0: of no picture.
    """

    def __init__(self, caution: float, familiar: float) -> None:
        super().__init__()
        self.caution = caution
        self.familiar = familiar
        self.strange = STRANGE
        self.unsure, self.sure = UNSURE, SURE
        self.lean = LEAN
        self.span = DOUBT_SPAN

    def forward(self, plane: Tensor, confidence_logit: Tensor, near: Tensor) -> Tensor:
        """The dense depth's plane, nearer where it is doubtful and geometry is nearer.

        Args:
            plane: (B, 1, h, w), the dense depth.
            confidence_logit: (B, 1, h, w).
            near: (B, 1, h, w), the nearest return, or the road where that is nearer.
        """
        confidence = torch.sigmoid(confidence_logit)
        doubt = ((self.caution - confidence) / self.span).clamp(0.0, 1.0)
        if self.familiar > 0.0:
            surely = ((confidence - self.unsure) / (self.sure - self.unsure)).clamp(0.0, 1.0)
            share = surely.mean(dim=(1, 2, 3), keepdim=True) / self.familiar
            doubt = doubt * ((1.0 - share) / (1.0 - self.strange)).clamp(0.0, 1.0)
        return plane - self.lean * doubt * (plane - near).clamp(min=0.0)


class CautiousDepth(nn.Module):
    """The same for a network that has not drawn the geometry itself.

    Args:
        caution: As for `Caution`.
        familiar: As for `Caution`.
        min_depth_m: Nearest depth.
        max_depth_m: Farthest depth.
    """

    def __init__(self, caution: float, familiar: float, min_depth_m: float, max_depth_m: float) -> None:
        super().__init__()
        self.min_depth_m = min_depth_m
        self.max_depth_m = max_depth_m
        self.rasterise = Rasterise(min_depth_m, max_depth_m, True, RETURNS_PER_CELL, 1)
        self.caution = Caution(caution, familiar)

    def forward(
        self, depth_m: Tensor, confidence_logit: Tensor, radar: Tensor, valid: Tensor, ground: Tensor
    ) -> Tensor:
        """The dense depth (B, 1, H, W) metres; radar, valid and ground as `interface` has them."""
        size = (depth_m.shape[2], depth_m.shape[3])
        near = self.rasterise.near(radar, valid, ground, size[0], size[1])
        near = functional.interpolate(near, size, mode="nearest")
        plane = depth_to_plane(depth_m, self.min_depth_m, self.max_depth_m)
        leant = self.caution(plane, confidence_logit.float(), near)
        return plane_to_depth(leant, self.min_depth_m, self.max_depth_m)
