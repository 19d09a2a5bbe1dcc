"""`baff`: radar-pixel association, bidirectional fusion and parallel attention.

"Depth Estimation Based on MMwave Radar and Camera Fusion with Attention Mechanisms and Multi-Scale Features for
Autonomous Driving Vehicles", Electronics 2025. Section and equation numbers in comments are of that paper.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.association import (
    CELL_PX,
    FEATURES,
    OUTSIDE,
    EmbeddingAssociation,
    PointEncoder,
    RegionAssociation,
)
from radcam_depth_ros.networks.attention import ChannelAttention, PositionAttention
from radcam_depth_ros.networks.blocks import (
    ConvBlock,
    ResidualEncoder,
    depth_to_plane,
    double,
    draw_nearest,
    ground_planes,
    nearest_returns,
    plane_to_depth,
    return_layers,
)
from radcam_depth_ros.networks.interface import Association, Candidates, Depths, Network, TrainOutputs
from radcam_depth_ros.networks.registry import ArchitectureError, register

FUSION_CHANNELS = (16, 32, 64, 128, 256)

CANDIDATES = 9
"""Depths that the head chooses between: see `Baff._image_planes`."""

FAVOURED = 4.0
"""Logit of the first candidate before training: it then weighs as much as fifty others."""


@dataclass(frozen=True)
class BaffConfig:
    """Architecture of `baff`.

    Attributes:
        association: `embedding` (one decoder pass however many returns) or `regions` (the paper's, one for each).
        threshold: tau, the confidence from which on a pixel takes its return's depth.
        region_width_px: Width of a return's region of interest, a multiple of 32. The paper's 288 px at nuScenes'
            focal length of 1266 px are 143 px at 630 px, and 160 is the next multiple.
        embedding_dims: Learned part of the vectors of `embedding`.
        radar_map_size: Rows and columns of the radar map of `regions`; the paper's (28, 9) for its larger image.
        bidirectional: The bottom-up branch (BF).
        channel_attention: CA.
        position_attention: PA.
        position_pool: How far keys and values are pooled at 1/2, 1/4, 1/8, 1/16; 1 is exact.
        ground_prior: Take the flat road's depth as input planes.
        candidates: Take depths that geometry alone and stage 1 suggest as input planes, and let the head choose between
            them: the flat road, the return nearest in the image, returns around a pixel from near to far, the return
            that stage 1 found. False is the paper's head.
        drawn_returns: Give stage 2 the returns as they are drawn into the image, besides the semi-dense depth.
        min_depth_m: Nearest depth that the network gives.
        max_depth_m: Farthest depth that the network gives.
        focal_length_px: The focal length that it is trained at.
    """

    association: str = "embedding"
    threshold: float = 0.5
    region_width_px: int = 160
    embedding_dims: int = 48
    radar_map_size: tuple[int, int] = (14, 5)
    bidirectional: bool = True
    channel_attention: bool = True
    position_attention: bool = True
    position_pool: tuple[int, int, int, int] = (16, 8, 4, 1)
    ground_prior: bool = True
    drawn_returns: bool = True
    candidates: bool = True
    min_depth_m: float = 1.0
    max_depth_m: float = 100.0
    focal_length_px: float = 630.0

    def __post_init__(self) -> None:
        if self.association not in ("embedding", "regions"):
            raise ArchitectureError(f"association must be 'embedding' or 'regions', got {self.association!r}")
        if self.region_width_px % CELL_PX or self.region_width_px < CELL_PX:
            raise ArchitectureError(f"region_width_px must be a multiple of {CELL_PX}, got {self.region_width_px}")
        if not 0 < self.min_depth_m < self.max_depth_m:
            raise ArchitectureError(
                f"the depth range must be 0 < min < max metres, got {self.min_depth_m} to {self.max_depth_m}"
            )
        if not 0 < self.threshold < 1:
            raise ArchitectureError(f"threshold must lie between 0 and 1, got {self.threshold}")


PAPER: Mapping[str, Any] = MappingProxyType(
    {
        "association": "regions",
        "region_width_px": 288,
        "radar_map_size": (28, 9),
        "candidates": False,
        "drawn_returns": False,
        "ground_prior": False,
    }
)
"""The paper's form, for images of 900 x 1600 as they are."""


class Gate(nn.Module):
    """P_i = Conv1x1(I_f + D_f * sigmoid(Conv(D_f))), equations 3 and 4; the sigmoid is METHODS A's reading."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Conv2d(channels, channels, 3, padding=1)
        # Normalised, since what goes down is a sum over all levels: without, the coarsest one outgrows the others.
        self.project = nn.Sequential(nn.Conv2d(channels, channels, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, image: Tensor, depth: Tensor) -> Tensor:
        result: Tensor = self.project(image + depth * torch.sigmoid(self.weight(depth)))
        return result


class ParallelAttention(nn.Module):
    """CA(F) + PA(F), with either or both left out for ablation."""

    def __init__(self, channels: int, pool: int, use_channel: bool, use_position: bool) -> None:
        super().__init__()
        branches: list[nn.Module] = []
        if use_channel:
            branches.append(ChannelAttention())
        if use_position:
            branches.append(PositionAttention(channels, pool))
        if not branches:
            branches.append(nn.Identity())
        self.branches = nn.ModuleList(branches)

    def forward(self, x: Tensor) -> Tensor:
        total = torch.zeros_like(x)
        for branch in self.branches:
            total = total + branch(x)
        return total


class FusionNetwork(nn.Module):
    """Stage 2: gated encoders, bidirectional fusion, parallel attention, head (sections 3.3 to 3.5)."""

    def __init__(self, image_planes: int, config: BaffConfig) -> None:
        super().__init__()
        channels = FUSION_CHANNELS
        self.bidirectional = config.bidirectional
        self.image_encoder = ResidualEncoder(image_planes, channels)
        # Deviation: the paper's depth branch sees the semi-dense depth alone. A return that won no pixel is lost to it.
        depth_planes = 2 + (2 if config.drawn_returns else 0) + (CANDIDATES if config.candidates else 0)
        self.depth_encoder = ResidualEncoder(depth_planes, channels)
        # Deviation: what stage 1 learned of the image is used again. 0 at first, so that training starts as without.
        norm = nn.BatchNorm2d(channels[1])
        nn.init.zeros_(norm.weight)
        self.shared = nn.Sequential(nn.Conv2d(FEATURES, channels[1], 1, bias=False), norm)
        self.gates = nn.ModuleList([Gate(width) for width in channels])
        # Coarsest first: TorchScript cannot walk a list of modules backwards.
        self.top_down = nn.ModuleList([ConvBlock(channels[i + 1], channels[i]) for i in (3, 2, 1, 0)])
        self.bottom_up = nn.ModuleList()
        if config.bidirectional:
            first = ConvBlock(channels[0], channels[0])
            self.bottom_up.extend([first, *(ConvBlock(channels[i - 1], channels[i], stride=2) for i in range(1, 4))])
        self.attention = nn.ModuleList(
            [
                ParallelAttention(
                    channels[i], config.position_pool[i], config.channel_attention, config.position_attention
                )
                for i in range(4)
            ]
        )
        self.refine = nn.ModuleList([ConvBlock(channels[i + 1], channels[i]) for i in (2, 1, 0)])
        last = nn.Conv2d(channels[0], 2 + (CANDIDATES if config.candidates else 0), 3, padding=1)
        if config.candidates:
            # Training starts from the first candidate.
            nn.init.zeros_(last.weight)
            bias = torch.zeros(last.out_channels)
            bias[2] = FAVOURED
            last.bias = nn.Parameter(bias)
        self.head = nn.Sequential(ConvBlock(channels[0], channels[0]), last)

    def forward(self, image: Tensor, features: Tensor, depth: Tensor) -> Tensor:
        """Image planes, stage 1's features and depth planes to what the head gives, (B, 2 + K, H, W).

        The first two are depth and confidence before their sigmoids, the others the candidates' logits.
        """
        fused: list[Tensor] = []
        image_maps = self.image_encoder(image)
        image_maps[1] = image_maps[1] + self.shared(features)
        depth_maps = self.depth_encoder(depth)
        for index, gate in enumerate(self.gates):
            fused.append(gate(image_maps[index], depth_maps[index]))
        down = self._top_down(fused)
        both = self._bottom_up(fused, down) if self.bidirectional else down
        attended: list[Tensor] = []
        for index, attention in enumerate(self.attention):
            attended.append(attention(both[index]))
        x = attended[3]
        # A_i = Conv(Up(A_{i+1})) + CA(F'_i) + PA(F'_i), equation 7, from i = 3 to 1.
        for index, refine in enumerate(self.refine):
            x = refine(double(x)) + attended[2 - index]
        result: Tensor = self.head(double(x))
        return result

    def _top_down(self, fused: list[Tensor]) -> list[Tensor]:
        # F_5 = P_5; F_i = Conv(Up(F_{i+1})) + P_i, equation 5; finest first, F_5 itself is not needed after.
        x = fused[4]
        maps: list[Tensor] = []
        for index, conv in enumerate(self.top_down):
            x = conv(double(x)) + fused[3 - index]
            maps.insert(0, x)
        return maps

    def _bottom_up(self, fused: list[Tensor], down: list[Tensor]) -> list[Tensor]:
        # F'_1 = Conv(F_1) + P_1; F'_i = Conv(Down(F'_{i-1})) + F_i + P_i, equation 6.
        maps: list[Tensor] = []
        x = down[0]
        for index, conv in enumerate(self.bottom_up):
            x = conv(x) + fused[index]
            if index > 0:
                x = x + down[index]
            maps.append(x)
        return maps


@register("baff")
class Baff(Network):
    """Both stages; see `interface` for what it takes and gives."""

    config_type = BaffConfig
    parts = ("association", "fusion")
    stages = (
        ("association", "association"),
        ("image encoder", "fusion.image_encoder"),
        ("depth encoder", "fusion.depth_encoder"),
        *(("gates", f"fusion.gates.{index}") for index in range(5)),
        *(("bidirectional fusion", f"fusion.top_down.{index}") for index in range(4)),
        *(("bidirectional fusion", f"fusion.bottom_up.{index}") for index in range(4)),
        *((f"attention 1/{2 << index}", f"fusion.attention.{index}") for index in range(4)),
        *(("refinement", f"fusion.refine.{index}") for index in range(3)),
        ("head", "fusion.head"),
    )
    paper = PAPER

    def __init__(self, config: BaffConfig) -> None:
        super().__init__(config)
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.threshold = config.threshold
        self.ground_prior = config.ground_prior
        self.drawn_returns = config.drawn_returns
        self.candidates = config.candidates
        self.outside = OUTSIDE
        planes = 3 + (2 if config.ground_prior else 0) + (2 if config.candidates else 0)
        points = PointEncoder(config.focal_length_px, config.min_depth_m, config.max_depth_m)
        if config.association == "embedding":
            self.association: EmbeddingAssociation | RegionAssociation = EmbeddingAssociation(
                planes, points, config.embedding_dims, config.region_width_px
            )
        else:
            self.association = RegionAssociation(planes, points, config.region_width_px, config.radar_map_size)
        self.fusion = FusionNetwork(planes, config)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        planes, candidates = self._image_planes(image, radar, valid, ground)
        best, depth, features = self.association(planes, radar, valid)
        return self._fuse(planes, features, candidates, best, depth, radar, valid)[0]

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> TrainOutputs:
        """The forward pass with what the losses need.

        Stage 2 takes stage 1's depth as it stands, and its choice of the strongest return passes no gradient back, as
        in the paper; stage 1's features learn from both.
        """
        planes, suggested = self._image_planes(image, radar, valid, ground)
        association: Association | None = None
        if _learns(self.association):
            association, best, depth, features = self.association.train_outputs(planes, radar, valid)
        else:
            with torch.no_grad():
                best, depth, features = self.association(planes, radar, valid)
        if not _learns(self.fusion):
            return TrainOutputs(None, None, association, None)
        depths, confidence_logit, logits, suggested = self._fuse(planes, features, suggested, best, depth, radar, valid)
        candidates: Candidates | None = None
        if self.candidates:
            candidates = Candidates(logits, plane_to_depth(suggested, self.min_depth_m, self.max_depth_m))
        return TrainOutputs(depths, confidence_logit, association, candidates)

    def _image_planes(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> tuple[Tensor, Tensor]:
        """What both stages see, and the candidates that geometry gives: (B, CANDIDATES - 1, H, W), or none."""
        height, width = image.shape[2], image.shape[3]
        planes = [image * 2.0 - 1.0]
        road = ground_planes(ground, height, width, self.min_depth_m, self.max_depth_m)
        if self.ground_prior:
            planes.append(road.to(image.dtype))
        if not self.candidates:
            return torch.cat(planes, dim=1), image[:, :0]
        # An unknown road is 0 in both of its planes; as a candidate it is far away.
        flat = torch.where(road[:, 1:] > 0, road[:, :1], torch.ones_like(road[:, :1]))
        depth, distance = nearest_returns(radar, valid, height, width)
        nearest = self._plane(depth)
        # Near returns say much, far ones little; 0 where there is none at all.
        closeness = torch.exp(-distance / 40.0)
        both = functional.interpolate(torch.cat([nearest, closeness], dim=1), size=(height, width), mode="bilinear")
        nearest = torch.minimum(flat, both[:, :1])
        planes.append(nearest.to(image.dtype))
        planes.append(both[:, 1:].to(image.dtype))
        layers = self._plane(return_layers(radar, valid, distance, [0.5, 0.1, 0.3, 0.7, 0.9]))
        layers = functional.interpolate(layers, size=(height, width), mode="nearest")
        # What is behind the road is hidden by it.
        first = torch.minimum(flat, layers[:, :1])
        return torch.cat(planes, dim=1), torch.cat([first, flat, nearest, layers], dim=1)

    def _plane(self, depth: Tensor) -> Tensor:
        """Depths as planes; where there is none (0), the farthest."""
        plane = depth_to_plane(depth, self.min_depth_m, self.max_depth_m)
        return torch.where(depth > 0, plane, torch.ones_like(plane))

    def _fuse(
        self,
        planes: Tensor,
        features: Tensor,
        candidates: Tensor,
        best: Tensor,
        depth: Tensor,
        radar: Tensor,
        valid: Tensor,
    ) -> tuple[Depths, Tensor, Tensor, Tensor]:
        """Stage 2: the depths, the confidence's logit, and the candidates' logits and planes."""
        probability = torch.sigmoid(best.detach().float())
        covered = probability > self.threshold
        semi_dense = torch.where(covered, depth, torch.full_like(depth, float("nan")))
        found = self._plane(torch.where(best > 0.5 * self.outside, depth, torch.zeros_like(depth)))
        size = (planes.shape[2], planes.shape[3])
        # The probability, not whether it passes tau: a plane that is 0 everywhere, as that would be before stage 1 has
        # learned anything, has no variance, and each batch norm on its way multiplies the gradient by 300.
        known = torch.cat([torch.where(covered, found, torch.zeros_like(found)), probability, found], dim=1)
        known = functional.interpolate(known, size=size, mode="nearest")
        if self.candidates:
            candidates = torch.cat([candidates, known[:, 2:]], dim=1)
        known = torch.cat([known[:, :2], candidates], dim=1)
        if self.drawn_returns:
            nearest = draw_nearest(radar, valid, size[0], size[1])
            hit = nearest > 0
            returns = torch.where(hit, depth_to_plane(nearest, self.min_depth_m, self.max_depth_m), 0.0)
            known = torch.cat([known, returns, hit.float()], dim=1)
        raw = self.fusion(planes, features, known.to(planes.dtype)).float()
        difference, confidence_logit, logits = torch.split(raw, [1, 1, raw.shape[1] - 2], dim=1)
        if self.candidates:
            # Deviation: the head chooses between depths that geometry and stage 1 suggest, and gives the difference
            # from their mean, so that a plain road, or a wall full of returns, need not be learned.
            plane = (torch.softmax(logits, dim=1) * candidates).sum(dim=1, keepdim=True) + difference
            plane = plane.clamp(0.0, 1.0)
        else:
            plane = torch.sigmoid(difference)
        dense = plane_to_depth(plane, self.min_depth_m, self.max_depth_m)
        semi_dense = functional.interpolate(semi_dense, size=size, mode="nearest")
        return Depths(dense, semi_dense, torch.sigmoid(confidence_logit)), confidence_logit, logits, candidates


def _learns(module: nn.Module) -> bool:
    return any(parameter.requires_grad for parameter in module.parameters())
