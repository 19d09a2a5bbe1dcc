"""`lircdepth`: a light network that learns from a larger one ([Sun2025])."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.distillation import DistillationFeatures
from radcam_depth_ros.networks.interface import Depths, SinglePass
from radcam_depth_ros.networks.layers.caution import CautiousDepth, check_caution
from radcam_depth_ros.networks.layers.ground import GroundPrior
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence, TrustedReturns, sky_head
from radcam_depth_ros.networks.layers.mobilenet import ConvNormRelu, InvertedResidual, PyramidEncoder
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d
from radcam_depth_ros.networks.layers.patches import alike, around, check_patch
from radcam_depth_ros.networks.layers.radar_channels import PLANES, draw_planes
from radcam_depth_ros.networks.layers.resnet import IMAGENET_DEVIATION, IMAGENET_MEAN
from radcam_depth_ros.networks.registry import register

IMAGE_CHANNELS = (64, 64, 128, 256, 512)
"""Of the image's maps after affinity, at 1/2, 1/4, 1/8, 1/16, 1/32: those of `cafnet`'s image encoder."""

RADAR_CHANNELS = (64, 128, 128, 512, 512)
"""Of the radar's maps after affinity: those of `cafnet`'s gated radar maps."""

WIDENING = 6
"""How much wider an inverted residual block is inside."""

DECODER = ((32, 2, 512), (16, 7, 128), (32, 2, 128), (32, 1, 64))
"""Of the decoder's stages to 1/16, 1/8, 1/4, 1/2: channels within, how many blocks have them, channels given."""

FINAL_WIDTH = 32
"""Channels at the image's size."""


@dataclass(frozen=True)
class LircdepthConfig(NetworkConfig):
    """Architecture of `lircdepth`.

    Attributes:
        threshold: tau, the score of `heads.TrustedReturns` above which a pixel of the semi-dense depth takes its
            return's depth.
        patch_px: Rows and columns around a return in which a pixel can take its depth, odd.
        tolerance: How far a return's depth may be off the dense depth of such a pixel, as a share of it.
        ground_prior: Take the flat road's depth as an input, and as a depth that the result may take.
        caution: Where the confidence is lower, the dense depth leans to geometry's, see `caution`. 0: nowhere.
        familiar: Share of sure pixels from which on depths of a picture do not lean, see `caution`. 0: of no picture.
        sky: Tell the sky, by a head of its own.
    """

    threshold: float = 0.07
    patch_px: tuple[int, int] = (61, 21)
    tolerance: float = 0.1
    ground_prior: bool = True
    caution: float = 0.7
    familiar: float = 0.38
    sky: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_caution(self.caution, self.familiar)
        check_patch(self.patch_px)
        if not 0 < self.tolerance < 1:
            raise ArchitectureError(f"tolerance must lie between 0 and 1, got {self.tolerance}")


class LircdepthOutputs(NamedTuple):
    """What the losses of `lircdepth` need.

    depths: As `forward` gives them.
    confidence_logit: (B, 1, H, W) float32, of `depths.confidence`.
    features: For distillation; those of the encoders after affinity.
    sky_logit: (B, 1, H, W) float32, of the sky; None where the network does not tell.
    """

    depths: Depths
    confidence_logit: Tensor
    features: DistillationFeatures
    sky_logit: Tensor | None = None


class Affinity(nn.Module):
    """1x1 convolution and ReLU of each of five maps."""

    def __init__(self, given: tuple[int, ...], wanted: tuple[int, ...]) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            nn.Conv2d(mine, theirs, 1, bias=False) for mine, theirs in zip(given, wanted, strict=True)
        )

    def forward(self, maps: list[Tensor]) -> list[Tensor]:
        result: list[Tensor] = []
        for index, layer in enumerate(self.layers):
            result.append(functional.relu(layer(maps[index])))
        return result


class Doubling(nn.Sequential):
    """Inverted residual block whose channel-wise convolution is transposed and doubles the size."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        inside = in_channels * WIDENING
        super().__init__(
            ConvNormRelu(in_channels, inside, kernel=1),
            nn.ConvTranspose2d(inside, inside, 3, 2, 1, output_padding=1, groups=inside, bias=False),
            nn.BatchNorm2d(inside),
            nn.ReLU6(inplace=True),
            nn.Conv2d(inside, out_channels, 1, bias=False),
            nn.BatchNorm2d(out_channels),
        )


class Decoder(nn.Module):
    """U-Net decoder of inverted residual blocks, with a depth at each of its inner scales.

    Args:
        out_channels: Of the result.
    """

    def __init__(self, out_channels: int) -> None:
        super().__init__()
        self.join = Affinity(RADAR_CHANNELS, IMAGE_CHANNELS)
        stages: list[nn.Module] = []
        channels = IMAGE_CHANNELS[4]
        for index, (width, count, out) in enumerate(DECODER):
            blocks: list[nn.Module] = [InvertedResidual(channels, width, 1, WIDENING)]
            blocks += [InvertedResidual(width, width, 1, WIDENING) for _ in range(count - 1)]
            stages.append(nn.Sequential(*blocks, Doubling(width, out)))
            channels = out + IMAGE_CHANNELS[3 - index]
        self.stages = nn.ModuleList(stages)
        self.depths = nn.ModuleList(Float32Conv2d(out, 1, 1) for _, _, out in DECODER[1:])
        self.full_size = nn.Sequential(
            nn.ConvTranspose2d(channels, FINAL_WIDTH, 3, 2, 1, output_padding=1, bias=False),
            nn.BatchNorm2d(FINAL_WIDTH),
            nn.ReLU6(inplace=True),
        )
        self.conv = ConvNormRelu(FINAL_WIDTH + len(self.depths), FINAL_WIDTH)
        self.head = Float32Conv2d(FINAL_WIDTH, out_channels, 3, padding=1)

    def forward(self, image: list[Tensor], radar: list[Tensor]) -> tuple[Tensor, list[Tensor], list[Tensor]]:
        """Decodes.

        Args:
            image: Maps of `IMAGE_CHANNELS` at 1/2, 1/4, 1/8, 1/16, 1/32.
            radar: The same, of `RADAR_CHANNELS`.

        Returns:
            The result (B, out_channels, H, W); the decoder's maps at 1/16, 1/8, 1/4, 1/2, 1; and the depths of those at
            1/8, 1/4, 1/2, each (B, 1, H, W), as shares of the farthest depth.
        """
        joined = self.join(radar)
        x = image[4] + joined[4]
        decoded: list[Tensor] = []
        for index, stage in enumerate(self.stages):
            decoded.append(stage(x))
            x = torch.cat([decoded[index], image[3 - index] + joined[3 - index]], dim=1)
        x = self.full_size(x)
        shares: list[Tensor] = []
        parts = [x]
        for index, depth in enumerate(self.depths):
            # Deviation: a sigmoid, where the public baseline has a ReLU, which may end at 0 for good.
            share = torch.sigmoid(depth(decoded[index + 1]))
            shares.append(functional.interpolate(share, size=(x.shape[2], x.shape[3]), mode="nearest"))
            parts.append(shares[index].to(x.dtype))
        x = self.conv(torch.cat(parts, dim=1))
        decoded.append(x)
        return self.head(x), decoded, shares


@register("lircdepth")
class Lircdepth(SinglePass):
    """Two light encoders and a decoder; see `interface` for what it takes and gives.

    The paper has neither confidence nor semi-dense depth. The confidence has a head of its own that passes no gradient
    on, so that all else learns as in the paper. The semi-dense depth is that of the return around a pixel that is most
    like the dense depth, where they agree and the confidence is high enough for its distance.
    """

    about = "two light encoders, learns from cafnet (LiRCDepth, 2025)"
    config_type = LircdepthConfig
    parts = (
        "image_encoder",
        "image_affinity",
        "radar_encoder",
        "radar_affinity",
        "ground",
        "decoder",
        "confidence",
        "sky",
    )
    sections = (
        ("image encoder", "image_encoder"),
        ("affinity", "image_affinity"),
        ("radar encoder", "radar_encoder"),
        ("affinity", "radar_affinity"),
        ("decoder", "decoder"),
        ("confidence", "confidence"),
        ("sky", "sky"),
    )
    backbones = ("image_encoder",)
    adjustable = ("threshold", "calibration", "patch_px", "tolerance", "caution", "familiar")
    grows = MappingProxyType({"sky": False})
    paper = MappingProxyType({"ground_prior": False, "caution": 0.0, "sky": False})
    mean: Tensor
    deviation: Tensor

    def __init__(self, config: LircdepthConfig) -> None:
        super().__init__(config)
        self.calibrated = CalibratedConfidence(config.calibration)
        self.trusted = TrustedReturns(config.threshold)
        self.patch_px = config.patch_px
        self.tolerance = config.tolerance
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN).reshape(1, 3, 1, 1), persistent=False)
        self.register_buffer("deviation", torch.tensor(IMAGENET_DEVIATION).reshape(1, 3, 1, 1), persistent=False)
        self.image_encoder = PyramidEncoder()
        self.radar_encoder = PyramidEncoder(PLANES)
        self.image_affinity = Affinity(PyramidEncoder.CHANNELS, IMAGE_CHANNELS)
        self.radar_affinity = Affinity(PyramidEncoder.CHANNELS, RADAR_CHANNELS)
        prior = GroundPrior(IMAGE_CHANNELS[4], config.min_depth_m, config.max_depth_m)
        self.ground = prior if config.ground_prior else None
        cautious = CautiousDepth(config.caution, config.familiar, config.min_depth_m, config.max_depth_m)
        self.cautious = cautious if config.caution > 0 else None
        self.decoder = Decoder(2 if config.ground_prior else 1)
        self.confidence = Float32Conv2d(FINAL_WIDTH, 1, 3, padding=1)
        self.sky = sky_head(FINAL_WIDTH) if config.sky else None

    def outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> LircdepthOutputs:
        height, width = image.shape[2], image.shape[3]
        planes = draw_planes(radar, valid, height, width, self.max_depth_m).to(image.dtype)
        seen = self.image_affinity(self.image_encoder((image - self.mean) / self.deviation))
        returned = self.radar_affinity(self.radar_encoder(planes))
        placed = seen
        if self.ground is not None:
            placed = seen[:4]
            placed.append(self.ground(ground, seen[4]))
        raw, decoded, shares = self.decoder(placed, returned)
        # From the nearest depth on, not from 0 as in the paper.
        dense = self.min_depth_m + (self.max_depth_m - self.min_depth_m) * torch.sigmoid(raw[:, :1])
        if self.ground is not None:
            dense = self.ground.blend(dense, raw[:, 1:], ground)
        logit = self.confidence(decoded[4].detach())
        confidence = torch.sigmoid(logit)
        patches = around(radar, valid, height, width, self.patch_px)
        semi_dense = self.trusted(alike(patches, radar, dense.detach(), self.tolerance), dense, confidence)
        if self.cautious is not None and not self.training:
            dense = self.cautious(dense, logit, radar, valid, ground)
        inter_depth_m = [self.max_depth_m * share for share in shares]
        features = DistillationFeatures(seen, returned, decoded, inter_depth_m)
        sky_logit = None if self.sky is None else self.sky(decoded[4])
        sky = None if sky_logit is None else torch.sigmoid(sky_logit)
        depths = Depths(dense, semi_dense, self.calibrated(logit), None, sky)
        return LircdepthOutputs(depths, logit, features, sky_logit)
