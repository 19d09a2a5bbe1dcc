"""Stage 2 of `baff` at a quarter of the image size: the head chooses between depths of geometry and stage 1."""

import itertools
from typing import NamedTuple

import torch
from torch import Tensor, nn

from radcam_depth_ros.networks.baff.detail import Detail
from radcam_depth_ros.networks.baff.fusion import BidirectionalFusion, Gates, Refinement
from radcam_depth_ros.networks.layers.blocks import ConvBlock, PlanarConv, Projection
from radcam_depth_ros.networks.layers.rasterise import peak, support

CANDIDATES = 8
"""Depths that the head chooses between, see `QuarterFusion.candidates`."""

DEPTH_BINS = 10
"""Depths besides that are the same for every image: what neither road nor radar tells, a picture alone may."""

NEAREST_BIN, FARTHEST_BIN = 0.3, 0.95
"""Planes of the first and the last of them: 4 and 79 m where depths reach from 1 to 100 m, each 1.4 times the last."""

FAVOURED = 4.0
"""Logit of the first candidate before training: it then weighs as much as fifty others."""


class Choice(NamedTuple):
    """What the head gives for each of the parts, detail x detail, of a pixel at a quarter of the image's size.

    plane: (B, 1, h detail, w detail), the dense depth.
    confidence_logit: (B, 1, h detail, w detail).
    logits: (B, CANDIDATES, detail detail, h, w), of the candidates.
    bin_logits: (B, DEPTH_BINS, h, w), of the bins, which all parts of a pixel share.
    bins_more: (B, 1, detail detail, h, w), what is added to all of them for a part.
    parts: (B, 3, detail detail, h, w), planes of the candidates that differ between the parts of a pixel.
    others: (B, 5, h, w), planes of the others.
    near: (B, 1, h detail, w detail), the nearest return, or the road where that is nearer.
    features: (B, channels, h, w), which the head chose by.
    weights: (B, 16, h detail, w detail), logits of weights as `detail.enlarged` takes them; of no use without
        `full_size`.
    """

    plane: Tensor
    confidence_logit: Tensor
    logits: Tensor
    bin_logits: Tensor
    bins_more: Tensor
    parts: Tensor
    others: Tensor
    near: Tensor
    features: Tensor
    weights: Tensor


class DepthEncoder(nn.Module):
    """Encodes depth planes at a quarter of the image's size to the levels of the image encoder, one convolution each.

    Args:
        planes: Planes of the input.
        channels: Channels at 1/4, 1/8, 1/16, 1/32.
    """

    def __init__(self, planes: int, channels: tuple[int, ...]) -> None:
        super().__init__()
        self.levels = nn.ModuleList(
            ConvBlock(before, after, stride=1 if index == 0 else 2, raw=index == 0)
            for index, (before, after) in enumerate(itertools.pairwise((planes, *channels)))
        )

    def forward(self, planes: Tensor) -> list[Tensor]:
        """Takes (B, planes, h, w) float32 to maps of h, h / 2, h / 4, h / 8 rows."""
        x = planes
        maps: list[Tensor] = []
        for level in self.levels:
            x = level(x)
            maps.append(x)
        return maps


class QuarterFusion(nn.Module):
    """Stage 2 at a quarter of the image's size, on the maps of the image encoder that stage 1 uses as well.

    Deviations: levels begin at 1/4, convolutions come before up-sampling, and the head gives weights of depths that
    geometry and stage 1 suggest, for detail x detail parts of each pixel, and a difference from their mean: a plain
    road, or a wall full of returns, need not be learned.

    Args:
        channels: Of the image encoder's maps at 1/4, 1/8, 1/16, 1/32.
        features: Channels of stage 1's features.
        pools: How far keys and values of PA are pooled at 1/8 and 1/16.
        bottom_up: BF.
        channel_attention: CA.
        position_attention: PA.
        detail: Parts of a pixel along each axis.
        full_size: Whether the choice is corrected at half the image's size, see `detail.Detail`; for 2 parts.
    """

    keeps_float32 = True  # the bins
    bins: Tensor

    def __init__(
        self,
        channels: tuple[int, ...],
        features: int,
        pools: tuple[int, ...],
        bottom_up: bool,
        channel_attention: bool,
        position_attention: bool,
        detail: int,
        full_size: bool,
    ) -> None:
        super().__init__()
        self.detail = detail
        # Deviation: the paper's depth branch sees the semi-dense depth alone. A return that won no pixel is lost to it.
        self.depth_encoder = DepthEncoder(4 + 2 * CANDIDATES, channels)
        # Deviation: what stage 1 learned of the image is used again. 0 at first, so that training starts as without.
        self.shared = Projection(features, channels[0])
        nn.init.zeros_(self.shared.get_parameter("1.weight"))
        self.gates = Gates(channels, 1)
        self.bidirectional = BidirectionalFusion(channels, bottom_up, coarse=True)
        self.refinement = Refinement(channels[:3], pools, channel_attention, position_attention, coarse=True)
        # Training starts from the first candidate.
        bias = torch.zeros(2 + CANDIDATES, detail * detail)
        bias[2] = FAVOURED
        # One weight of a bin for all parts of a pixel.
        bias = torch.cat([bias.flatten(), torch.zeros(DEPTH_BINS)])
        self.head = nn.Sequential(ConvBlock(channels[0], channels[0]), PlanarConv(channels[0], bias))
        # Of each part: all that the head gives of it, and a logit for the bins together.
        self.fine = Detail(channels[0], 3 + CANDIDATES) if full_size else None
        self.register_buffer("bins", torch.linspace(NEAREST_BIN, FARTHEST_BIN, DEPTH_BINS), persistent=False)

    def forward(
        self,
        image: Tensor,
        maps: list[Tensor],
        features: Tensor,
        planes: Tensor,
        road: Tensor,
        suggested: Tensor,
        profile: Tensor,
    ) -> Choice:
        """Chooses the depth of each part of a pixel.

        Args:
            image: (B, 3, H, W).
            maps: Of the image encoder.
            features: (B, features, h, w) of stage 1.
            planes: (B, 4, h, w): semi-dense depth, its probability, returns where they are, whether there is one.
            road: (B, 1, h detail, w detail) the flat road's plane.
            suggested: (B, 5, h, w) planes: the nearest return, quantiles of the returns around, stage 1's return.
            profile: (B, bins, w) returns by depth, as `rasterise.Geometry`.
        """
        most = peak(profile).expand(-1, -1, suggested.shape[2], -1)
        parts, others = self.candidates(road, torch.cat([suggested, most], dim=1))
        known = torch.cat([parts.mean(dim=2), others], dim=1)
        evidence = support(profile, known)
        depth_maps = self.depth_encoder(torch.cat([planes, known, evidence], dim=1))
        image_maps = [maps[0] + self.shared(features), maps[1], maps[2], maps[3]]
        fused = self.gates(image_maps, depth_maps)
        # Rows of a plane together in memory: a softmax over few values that lie side by side is slow.
        refined = self.refinement(self.bidirectional(fused))
        raw = self.head(refined)
        batch, rows, columns = raw.shape[0], raw.shape[2], raw.shape[3]
        first_bin = raw.shape[1] - self.bins.shape[0]
        bin_logits = raw[:, first_bin:]
        raw = raw[:, :first_bin].reshape(batch, -1, self.detail * self.detail, rows, columns)
        more = torch.zeros_like(raw[:, :1])
        weights = bin_logits
        if self.fine is not None:
            finer, weights = self.fine(image, refined)
            finer = self.gather(finer)
            raw, more = raw + finer[:, :-1], finer[:, -1:]
        logits = raw[:, 2:]
        # The bins are as one more candidate, their mean, that weighs as much as they do together.
        bins = (torch.softmax(bin_logits, dim=1) * self.bins.reshape(1, -1, 1, 1)).sum(dim=1, keepdim=True)
        together = torch.logsumexp(bin_logits, dim=1, keepdim=True).unsqueeze(2) + more
        share = torch.softmax(torch.cat([logits, together], dim=1), dim=1)
        singles = torch.cat([others, bins], dim=1).unsqueeze(2)
        plane = raw[:, 0] + (share[:, :3] * parts).sum(dim=1) + (share[:, 3:] * singles).sum(dim=1)
        return Choice(
            self.spread(plane.clamp(0.0, 1.0).unsqueeze(1)),
            self.spread(raw[:, 1:2]),
            logits,
            bin_logits,
            more,
            parts,
            others,
            self.spread(parts[:, 2:]),
            refined,
            weights,
        )

    def hypotheses(self, choice: Choice) -> tuple[Tensor, Tensor]:
        """Logits and planes of all candidates and bins, both (B, CANDIDATES + DEPTH_BINS, h detail, w detail)."""
        parts = self.detail * self.detail
        bins = self.bins.reshape(1, -1, 1, 1).expand_as(choice.bin_logits)
        others = torch.cat([choice.others, bins], dim=1).unsqueeze(2).expand(-1, -1, parts, -1, -1)
        bin_logits = choice.bin_logits.unsqueeze(2) + choice.bins_more
        logits = torch.cat([choice.logits, bin_logits], dim=1)
        return self.spread(logits), self.spread(torch.cat([choice.parts, others], dim=1))

    def candidates(self, road: Tensor, suggested: Tensor) -> tuple[Tensor, Tensor]:
        """What the head chooses between, as `Choice` has it; arguments as in `forward`.

        The middle quantile of the returns around or the road where that is nearer, the road, the nearest return or the
        road; the quantiles, stage 1's return, the depth of most returns of the column.
        """
        flat = self.gather(road)
        # What is behind the road is hidden by it.
        nearest, middle = suggested[:, :1].unsqueeze(2), suggested[:, 1:2].unsqueeze(2)
        flat = torch.cat([torch.minimum(flat, middle), flat, torch.minimum(flat, nearest)], dim=1)
        return flat, suggested[:, 1:]

    def spread(self, x: Tensor) -> Tensor:
        """(B, C, detail detail, h, w) to (B, C, h detail, w detail)."""
        batch, channels, rows, columns = x.shape[0], x.shape[1], x.shape[3], x.shape[4]
        x = x.reshape(batch, channels, self.detail, self.detail, rows, columns).permute(0, 1, 4, 2, 5, 3)
        return x.reshape(batch, channels, rows * self.detail, columns * self.detail)

    def gather(self, x: Tensor) -> Tensor:
        """(B, C, h detail, w detail) to (B, C, detail detail, h, w), the reverse of `spread`."""
        batch, channels = x.shape[0], x.shape[1]
        rows, columns = x.shape[2] // self.detail, x.shape[3] // self.detail
        x = x.reshape(batch, channels, rows, self.detail, columns, self.detail).permute(0, 1, 3, 5, 2, 4)
        return x.reshape(batch, channels, self.detail * self.detail, rows, columns)
