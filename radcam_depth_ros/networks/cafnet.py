"""`cafnet`: radar confidence first, then fusion gated by it ([Sun2024], in the form of the teacher of [Sun2025])."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.config import NetworkConfig
from radcam_depth_ros.networks.distillation import DistillationFeatures
from radcam_depth_ros.networks.interface import Depths, SinglePass
from radcam_depth_ros.networks.layers.ground import GroundPrior
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence, sky_head
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d
from radcam_depth_ros.networks.layers.patches import Patches, around, check_patch, covered
from radcam_depth_ros.networks.layers.planar_guidance import WIDTHS, ConvElu, PlanarDecoder, UpConv
from radcam_depth_ros.networks.layers.radar_channels import PLANES, draw_planes
from radcam_depth_ros.networks.layers.resnet import CHANNELS, RESNET_18, RESNET_34, Levels, ResNet
from radcam_depth_ros.networks.layers.sparse import SparseConv
from radcam_depth_ros.networks.registry import register

SPARSE_WIDTHS = (16, 16, 16, 3)
SPARSE_KERNELS = (7, 5, 3, 3)

COARSE_WIDTHS = (256, 128, 64, 32, 32)
"""Channels of stage 1's decoder at 1/16, 1/8, 1/4, 1/2, 1."""


@dataclass(frozen=True)
class CafnetConfig(NetworkConfig):
    """Architecture of `cafnet`.

    Attributes:
        threshold: tau, the confidence from which on a pixel of the semi-dense depth takes stage 1's depth.
        patch_px: Rows and columns around a return that may belong to it, odd. The public baseline's 150 x 50 px at
            nuScenes' focal length of 1266 px are 37 x 13 px at 315 px.
        ground_prior: Take the flat road's depth as an input, and as a depth that the result may take.
        sky: Tell the sky, by a head of its own.
    """

    threshold: float = 0.4
    patch_px: tuple[int, int] = (37, 13)
    ground_prior: bool = True
    sky: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_patch(self.patch_px)


class CafnetOutputs(NamedTuple):
    """What the losses of `cafnet` need.

    depths: As `forward` gives them.
    coarse_m: Stage 1's depth, (B, 1, H, W) float32 metres.
    confidence_logit: (B, 1, H, W) float32, of the probability that a radar return belongs to a pixel.
    patches: The pixels around each return that may belong to it.
    features: For distillation; the radar's are those of stage 2, gated.
    sky_logit: (B, 1, H, W) float32, of the sky; None where the network does not tell.
    """

    depths: Depths
    coarse_m: Tensor
    confidence_logit: Tensor
    patches: Patches
    features: DistillationFeatures
    sky_logit: Tensor | None = None


class RadarEncoder(Levels):
    """ResNet-18 of three channels that are no colours: maps of `CHANNELS` at 1/2, 1/4, 1/8, 1/16, 1/32."""

    def __init__(self) -> None:
        super().__init__(RESNET_18)
        self.conv1 = nn.Conv2d(3, CHANNELS[0], 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(CHANNELS[0])

    def forward(self, x: Tensor) -> list[Tensor]:
        return self.levels(functional.relu(self.bn1(self.conv1(x))))


class SparseStem(nn.Module):
    """Four sparsity-invariant convolutions with ELU at the image's size."""

    def __init__(self) -> None:
        super().__init__()
        widths = (PLANES, *SPARSE_WIDTHS)
        self.layers = nn.ModuleList(
            SparseConv(widths[index], widths[index + 1], kernel) for index, kernel in enumerate(SPARSE_KERNELS)
        )

    def forward(self, planes: Tensor) -> Tensor:
        """Takes (B, 4, H, W), depth first, to (B, 3, H, W)."""
        x, known = planes, (planes[:, :1] > 0).to(planes.dtype)
        for layer in self.layers:
            x, known = layer(x, known)
            x = functional.elu(x)
        return x


class CoarseDecoder(nn.Module):
    """Stage 1's decoder: the maps of image and radar side by side, to depth and confidence."""

    def __init__(self) -> None:
        super().__init__()
        inputs = [2 * CHANNELS[4]]
        inputs += [2 * skip + width for skip, width in zip(CHANNELS[3::-1], COARSE_WIDTHS, strict=False)]
        self.levels = nn.ModuleList(
            nn.Sequential(UpConv(wide, width), nn.BatchNorm2d(width), ConvElu(width, width))
            for wide, width in zip(inputs, COARSE_WIDTHS, strict=True)
        )
        self.head = Float32Conv2d(COARSE_WIDTHS[-1], 2, 3, padding=1, bias=False)

    def forward(self, image: list[Tensor], radar: list[Tensor]) -> Tensor:
        """Takes maps at 1/2, 1/4, 1/8, 1/16, 1/32 to the logits (B, 2, H, W) of depth and confidence."""
        x = torch.cat([image[4], radar[4]], dim=1)
        for index, level in enumerate(self.levels):
            x = level(x)
            if index < 4:
                x = torch.cat([image[3 - index], radar[3 - index], x], dim=1)
        result: Tensor = self.head(x)
        return result


class ConfidenceGate(nn.Module):
    """Lets radar features through where they are relevant, by what they are themselves, and where radar is sure."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.relevance = nn.Conv2d(in_channels, out_channels, 1, bias=False)
        self.projection = nn.Conv2d(in_channels, out_channels, 1, bias=False)

    def forward(self, x: Tensor, confidence: Tensor) -> Tensor:
        return torch.sigmoid(self.relevance(x)) * functional.relu(self.projection(x)) * confidence


@register("cafnet")
class Cafnet(SinglePass):
    """Both stages; see `interface` for what it takes and gives.

    `Depths.confidence` is stage 1's: the probability that a radar return belongs to a pixel, and so that the coarse
    depth there is a return's. It says nothing of the dense depth elsewhere.
    """

    about = "confidence-gated fusion, large, can teach lircdepth (CaFNet, 2024)"
    config_type = CafnetConfig
    parts = (
        "image_encoder",
        "sparse",
        "coarse_encoder",
        "coarse_decoder",
        "join",
        "radar_encoder",
        "gates",
        "ground",
        "decoder",
        "sky",
    )
    sections = (
        ("image encoder", "image_encoder"),
        ("radar, coarse", "sparse"),
        ("radar, coarse", "coarse_encoder"),
        ("radar, coarse", "coarse_decoder"),
        ("radar, fine", "join"),
        ("radar, fine", "radar_encoder"),
        *(("gates", f"gates.{index}") for index in range(5)),
        ("decoder", "decoder"),
        ("sky", "sky"),
    )
    backbones = ("image_encoder",)
    adjustable = ("threshold", "calibration")
    grows = MappingProxyType({"sky": False})
    paper = MappingProxyType({"ground_prior": False, "sky": False})

    def __init__(self, config: CafnetConfig) -> None:
        super().__init__(config)
        self.calibrated = CalibratedConfidence(config.calibration)
        self.threshold = config.threshold
        self.patch_px = config.patch_px
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.image_encoder = ResNet(RESNET_34)
        self.sparse = SparseStem()
        self.coarse_encoder = RadarEncoder()
        self.coarse_decoder = CoarseDecoder()
        self.join = ConvElu(PLANES + 2, 3)
        self.radar_encoder = RadarEncoder()
        self.gates = nn.ModuleList(
            ConfidenceGate(given, needed) for given, needed in zip(CHANNELS, PlanarDecoder.RADAR_CHANNELS, strict=True)
        )
        prior = GroundPrior(CHANNELS[4], config.min_depth_m, config.max_depth_m)
        self.ground = prior if config.ground_prior else None
        self.decoder = PlanarDecoder(CHANNELS, config.max_depth_m, 2 if config.ground_prior else 1)
        self.sky = sky_head(WIDTHS[-1]) if config.sky else None

    def outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> CafnetOutputs:
        height, width = image.shape[2], image.shape[3]
        planes = draw_planes(radar, valid, height, width, self.max_depth_m).to(image.dtype)
        maps = self.image_encoder(image)
        placed = maps
        if self.ground is not None:
            placed = maps[:4]
            placed.append(self.ground(ground, maps[4]))
        coarse = self.coarse_decoder(placed, self.coarse_encoder(self.sparse(planes)))
        coarse_m, logit = self._depth(coarse[:, :1]), coarse[:, 1:]
        confidence = torch.sigmoid(logit)
        # Deviation: weighted by the confidence, not cut at tau, so that tau can be set after the training.
        share = confidence * coarse_m / self.max_depth_m
        joined = self.join(torch.cat([share.to(image.dtype), confidence.to(image.dtype), planes], dim=1))
        gated: list[Tensor] = []
        sureness = confidence.to(image.dtype)
        returned = self.radar_encoder(joined)
        for index, gate in enumerate(self.gates):
            sureness = functional.avg_pool2d(sureness, 2)
            gated.append(gate(returned[index], sureness))
        logits, decoded, inter_depth_m = self.decoder(placed, gated)
        dense = self._depth(logits[:, :1])
        if self.ground is not None:
            dense = self.ground.blend(dense, logits[:, 1:], ground)
        # No label says that a pixel outside of all patches belongs to a return.
        patches = around(radar, valid, height, width, self.patch_px)
        found = covered(patches, height, width) & (confidence > self.threshold)
        semi_dense = torch.where(found, coarse_m, torch.full_like(coarse_m, float("nan")))
        features = DistillationFeatures(maps, gated, decoded, inter_depth_m)
        sky_logit = None if self.sky is None else self.sky(decoded[4])
        sky = None if sky_logit is None else torch.sigmoid(sky_logit)
        depths = Depths(dense, semi_dense, self.calibrated(logit), None, sky)
        return CafnetOutputs(depths, coarse_m, logit, patches, features, sky_logit)

    def _depth(self, logit: Tensor) -> Tensor:
        # From the nearest depth on, not from 0 as in the paper.
        return self.min_depth_m + (self.max_depth_m - self.min_depth_m) * torch.sigmoid(logit)
