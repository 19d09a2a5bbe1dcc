"""`baff`: radar-pixel association, bidirectional fusion and parallel attention.

"Depth Estimation Based on MMwave Radar and Camera Fusion with Attention Mechanisms and Multi-Scale Features for
Autonomous Driving Vehicles", Electronics 2025. Section and equation numbers in comments are of that paper.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.association import CELL_PX, EmbeddingAssociation, PointEncoder, RegionAssociation
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
)
from radcam_depth_ros.networks.interface import Depths, Network, TrainOutputs
from radcam_depth_ros.networks.registry import ArchitectureError, register

FUSION_CHANNELS = (16, 32, 64, 128, 256)


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
        geometric_anchor: Take depth from geometry alone as input planes, and give depth relative to it: the flat road,
            or the return that is nearest in the image where that is closer.
        drawn_returns: Give stage 2 the returns as they are drawn into the image, besides the semi-dense depth.
        min_depth_m: Nearest depth that the network gives.
        max_depth_m: Farthest depth that the network gives.
        focal_length_px: The focal length that it is trained at.
    """

    association: str = "embedding"
    threshold: float = 0.5
    region_width_px: int = 160
    embedding_dims: int = 32
    radar_map_size: tuple[int, int] = (14, 5)
    bidirectional: bool = True
    channel_attention: bool = True
    position_attention: bool = True
    position_pool: tuple[int, int, int, int] = (16, 8, 4, 1)
    ground_prior: bool = True
    drawn_returns: bool = True
    geometric_anchor: bool = True
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


class Gate(nn.Module):
    """P_i = Conv1x1(I_f + D_f * sigmoid(Conv(D_f))), equations 3 and 4; the sigmoid is METHODS A's reading."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.weight = nn.Conv2d(channels, channels, 3, padding=1)
        self.project = nn.Conv2d(channels, channels, 1)

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
        self.depth_encoder = ResidualEncoder(4 if config.drawn_returns else 2, channels)
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
        self.head = nn.Sequential(ConvBlock(channels[0], channels[0]), nn.Conv2d(channels[0], 2, 3, padding=1))

    def forward(self, image: Tensor, depth: Tensor) -> Tensor:
        """Image planes and depth planes to (B, 2, H, W): depth and confidence, before their sigmoids."""
        fused: list[Tensor] = []
        image_maps = self.image_encoder(image)
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

    def __init__(self, config: BaffConfig) -> None:
        super().__init__(config)
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.threshold = config.threshold
        self.ground_prior = config.ground_prior
        self.drawn_returns = config.drawn_returns
        self.geometric_anchor = config.geometric_anchor
        planes = 3 + (2 if config.ground_prior else 0) + (2 if config.geometric_anchor else 0)
        points = PointEncoder(config.focal_length_px, config.min_depth_m, config.max_depth_m)
        if config.association == "embedding":
            self.association: EmbeddingAssociation | RegionAssociation = EmbeddingAssociation(
                planes, points, config.embedding_dims, config.region_width_px
            )
        else:
            self.association = RegionAssociation(planes, points, config.region_width_px, config.radar_map_size)
        self.fusion = FusionNetwork(planes, config)

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        planes = self._image_planes(image, radar, valid, ground)
        best, depth = self.association(planes, radar, valid)
        return self._fuse(planes, best, depth, radar, valid)[0]

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> TrainOutputs:
        """The forward pass with what the losses need.

        Both stages learn at once: stage 2 takes stage 1's depth as it stands, and its choice of the strongest return
        passes no gradient back, so that the stages' losses stay separate, as in the paper.
        """
        planes = self._image_planes(image, radar, valid, ground)
        association, best, depth = self.association.train_outputs(planes, radar, valid)
        depths, confidence_logit = self._fuse(planes, best, depth, radar, valid)
        return TrainOutputs(depths, association, confidence_logit)

    def _image_planes(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Tensor:
        height, width = image.shape[2], image.shape[3]
        planes = [image * 2.0 - 1.0]
        road = ground_planes(ground, height, width, self.min_depth_m, self.max_depth_m)
        if self.ground_prior:
            planes.append(road.to(image.dtype))
        if self.geometric_anchor:
            depth, distance = nearest_returns(radar, valid, height, width)
            # Near returns say much, far ones little; 0 where there is none at all.
            closeness = torch.exp(-distance / 40.0)
            returns = depth_to_plane(depth, self.min_depth_m, self.max_depth_m)
            returns = torch.where(distance < 1.0e6, returns, torch.ones_like(returns))
            both = functional.interpolate(torch.cat([returns, closeness], dim=1), size=(height, width), mode="bilinear")
            # An unknown road is 0 in both of its planes.
            flat = torch.where(road[:, 1:] > 0, road[:, :1], torch.ones_like(road[:, :1]))
            planes.append(torch.minimum(flat, both[:, :1]).to(image.dtype))
            planes.append(both[:, 1:].to(image.dtype))
        return torch.cat(planes, dim=1)

    def _fuse(self, planes: Tensor, best: Tensor, depth: Tensor, radar: Tensor, valid: Tensor) -> tuple[Depths, Tensor]:
        covered = torch.sigmoid(best.float()) > self.threshold
        semi_dense = torch.where(covered, depth, torch.full_like(depth, float("nan")))
        plane = torch.where(covered, depth_to_plane(depth, self.min_depth_m, self.max_depth_m), 0.0)
        size = (planes.shape[2], planes.shape[3])
        # The probability, not whether it passes tau: a plane that is 0 everywhere, as that would be before stage 1 has
        # learned anything, has no variance, and each batch norm on its way multiplies the gradient by 300.
        # The probability, not whether it passes tau: a plane that is 0 everywhere, as that would be before stage 1 has
        # learned anything, has no variance, and each batch norm on its way multiplies the gradient by 300.
        known = torch.cat([plane, torch.sigmoid(best.detach().float())], dim=1)
        known = functional.interpolate(known, size=size, mode="nearest")
        if self.drawn_returns:
            nearest = draw_nearest(radar, valid, size[0], size[1])
            hit = nearest > 0
            returns = torch.where(hit, depth_to_plane(nearest, self.min_depth_m, self.max_depth_m), 0.0)
            known = torch.cat([known, returns, hit.float()], dim=1)
        raw = self.fusion(planes, known.to(planes.dtype)).float()
        logit = raw[:, :1]
        if self.geometric_anchor:
            # Deviation: the head gives the difference from geometry alone, so that a plain road, or a wall full of
            # returns, need not be learned. Clipped, since far depths from geometry say little.
            logit = logit + torch.logit(planes[:, -2:-1].float().clamp(0.05, 0.9))
        dense = plane_to_depth(torch.sigmoid(logit), self.min_depth_m, self.max_depth_m)
        confidence_logit = raw[:, 1:]
        semi_dense = functional.interpolate(semi_dense, size=size, mode="nearest")
        return Depths(dense, semi_dense, torch.sigmoid(confidence_logit)), confidence_logit
