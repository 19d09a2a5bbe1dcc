"""`structured`: an image branch and a radar branch, and a depth decoder for each part of a driving scene.

Section and figure numbers in comments are those of [Li2023].
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from radcam_depth_ros.classes import CLASS_GROUPS, CLASS_NAMES, GROUP_OF_CLASS
from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.interface import Depths, SinglePass
from radcam_depth_ros.networks.layers.caution import CautiousDepth, check_caution
from radcam_depth_ros.networks.layers.ground import GroundPrior
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence, TrustedReturns
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d
from radcam_depth_ros.networks.layers.rasterise import depth_to_plane, draw_nearest, plane_to_depth
from radcam_depth_ros.networks.layers.resnet import CHANNELS, RESNET_18, RESNET_34, Levels, ResNet
from radcam_depth_ros.networks.layers.sparse import SparseConv
from radcam_depth_ros.networks.layers.up_projection import LEVELS, UpDecoder
from radcam_depth_ros.networks.registry import register

BLOCKS = {"resnet18": RESNET_18, "resnet34": RESNET_34}

FUSIONS = ("single", "add", "conf", "seg")

CONFIDENCE_CHANNELS = 16


@dataclass(frozen=True)
class StructuredConfig(NetworkConfig):
    """Architecture of `structured`.

    Attributes:
        fusion: How three decoders make one depth: `seg` takes each pixel's from the decoder of what it shows, which a
            fourth one says; `conf` weighs them, `add` sums them up; `single` has one decoder, for comparison.
        backbone: Of the image: `resnet18`, or the paper's `resnet34`.
        radar_channels: Of the radar branch at 1/2, 1/4, 1/8, 1/16, 1/32.
        joined_channels: Of both branches together at 1/32, from which on decoders halve them four times.
        ground_prior: Take the flat road's depth as an input, and as a depth that each decoder may take.
        caution: Where the confidence is lower, the dense depth leans to geometry's, see `caution`. 0: nowhere.
        familiar: Share of sure pixels from which on depths of a picture do not lean, see `caution`. 0: of no picture.
        threshold: tau, the score of `heads.TrustedReturns` above which a pixel near a return has a semi-dense depth,
            the coarse one.
    """

    fusion: str = "seg"
    backbone: str = "resnet18"
    # The paper says "fewer"; a quarter of the image branch's makes its number of parameters (docs/decisions.md).
    radar_channels: tuple[int, int, int, int, int] = (16, 16, 32, 64, 128)
    joined_channels: int = 192
    ground_prior: bool = True
    caution: float = 0.7
    familiar: float = 0.38
    threshold: float = 0.06

    def __post_init__(self) -> None:
        super().__post_init__()
        check_caution(self.caution, self.familiar)
        if self.fusion not in FUSIONS:
            raise ArchitectureError(f"fusion must be one of {', '.join(FUSIONS)}, got {self.fusion!r}")
        if self.backbone not in BLOCKS:
            raise ArchitectureError(f"backbone must be one of {', '.join(BLOCKS)}, got {self.backbone!r}")
        if min(self.radar_channels) < 1:
            raise ArchitectureError(f"radar_channels must be at least 1, got {self.radar_channels}")
        if self.joined_channels < 1 or self.joined_channels % 2**LEVELS:
            raise ArchitectureError(f"joined_channels must be a multiple of {2**LEVELS}, got {self.joined_channels}")


class StructuredOutputs(NamedTuple):
    """What training needs of `structured`, all at the image's size.

    depths: As `forward` gives them.
    confidence_logit: (B, 1, H, W).
    coarse_m: (B, 1, H, W) metres, the radar branch's own depth.
    reached: (B, 1, H, W) bool, where that depth is of a return.
    class_logits: (B, 19, H, W), None without a class decoder.
    """

    depths: Depths
    confidence_logit: Tensor
    coarse_m: Tensor
    reached: Tensor
    class_logits: Tensor | None


class RadarEncoder(nn.Module):
    """The radar branch: sparsity-invariant convolutions, then residual blocks (section 3.2, figure 7).

    Args:
        blocks: Residual blocks at 1/4, 1/8, 1/16, 1/32, as the image branch's.
        channels: At 1/2, 1/4, 1/8, 1/16, 1/32.
    """

    def __init__(self, blocks: tuple[int, ...], channels: tuple[int, ...]) -> None:
        super().__init__()
        # At 1/2, where the image branch's residual blocks begin as well; figure 7 enlarges the coarse depth, too.
        width = channels[0]
        others = (SparseConv(width, width, side) for side in (5, 3, 3))
        self.sparse = nn.ModuleList([SparseConv(1, width, 7, stride=2), *others])
        self.activation = nn.ReLU()
        self.coarse = SparseConv(width, 1, 1, in_float32=True)
        self.residual = Levels(blocks, channels)

    def forward(self, plane: Tensor, known: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Takes (B, 1, H, W), 0 where unknown, and 1 where it is known.

        Returns:
            The map at 1/32; the logit of the coarse depth's plane and, 1 or 0, whether a return reaches it, at 1/2.
        """
        # Without any return all maps are even, and batch norms would multiply their gradients by 300 each: such a
        # sample has zeros from this branch, and takes no part in it.
        any_return = known.amax(dim=(2, 3), keepdim=True)
        x = plane
        for convolution in self.sparse:
            x, known = convolution(x, known)
            x = self.activation(x)
        coarse, known = self.coarse(x, known)
        maps = self.residual(x * known)
        return maps[4] * any_return, coarse, known


@register("structured")
class Structured(SinglePass):
    """The whole network; see `interface` for what it takes and gives."""

    about = "a decoder for each part of the scene; class image (Sensors 2023)"
    config_type = StructuredConfig
    parts = ("image_encoder", "radar_encoder", "join", "ground", "decoders", "class_decoder", "confidence")
    sections = (
        ("image encoder", "image_encoder"),
        ("radar encoder", "radar_encoder"),
        ("joining", "join"),
        *(("depth decoders", f"decoders.{index}") for index in range(len(CLASS_GROUPS))),
        ("class decoder", "class_decoder"),
        ("confidence", "confidence"),
    )
    backbones = ("image_encoder",)
    adjustable = ("threshold", "calibration", "caution", "familiar")
    paper = MappingProxyType(
        {"fusion": "seg", "backbone": "resnet34", "joined_channels": 256, "ground_prior": False, "caution": 0.0}
    )
    group_of_class: Tensor

    @classmethod
    def tells_classes(cls, config: StructuredConfig) -> bool:
        """With a class decoder, which `seg` has."""
        return config.fusion == "seg"

    def __init__(self, config: StructuredConfig) -> None:
        super().__init__(config)
        self.calibrated = CalibratedConfidence(config.calibration)
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.trusted = TrustedReturns(config.threshold)
        self.weighs = config.fusion == "conf"
        self.sky_class = CLASS_NAMES.index("sky")
        blocks, width = BLOCKS[config.backbone], config.joined_channels
        self.image_encoder = ResNet(blocks)
        self.radar_encoder = RadarEncoder(blocks, config.radar_channels)
        self.join = nn.Sequential(
            nn.Conv2d(CHANNELS[4] + config.radar_channels[4], width, 1, bias=False), nn.BatchNorm2d(width)
        )
        count = 1 if config.fusion == "single" else len(CLASS_GROUPS)
        prior = GroundPrior(width, config.min_depth_m, config.max_depth_m)
        self.ground = prior if config.ground_prior else None
        cautious = CautiousDepth(config.caution, config.familiar, config.min_depth_m, config.max_depth_m)
        self.cautious = cautious if config.caution > 0 else None
        values = 1 + int(self.weighs) + int(config.ground_prior)
        self.decoders = nn.ModuleList(UpDecoder(width, values) for _ in range(count))
        self.class_decoder = UpDecoder(width, len(CLASS_NAMES)) if config.fusion == "seg" else None
        features = (count + int(config.fusion == "seg")) * (width >> LEVELS)
        self.confidence = nn.Sequential(
            nn.Conv2d(features, CONFIDENCE_CHANNELS, 3, 1, 1, bias=False),
            nn.BatchNorm2d(CONFIDENCE_CHANNELS),
            nn.ReLU(),
            Float32Conv2d(CONFIDENCE_CHANNELS, 1, 3, 1, 1),
        )
        self.register_buffer("group_of_class", torch.tensor(GROUP_OF_CLASS), persistent=False)

    def outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> StructuredOutputs:
        size = (image.shape[2], image.shape[3])
        image_map = self.image_encoder(image)[4]
        drawn = draw_nearest(radar, valid, size[0], size[1], 1)
        plane = torch.where(drawn > 0, depth_to_plane(drawn, self.min_depth_m, self.max_depth_m), drawn)
        known = (drawn > 0).to(image.dtype)
        radar_map, coarse_logit, reached = self.radar_encoder(plane.to(image.dtype), known)
        joined = self.join(torch.cat([image_map, radar_map], dim=1))
        if self.ground is not None:
            joined = self.ground(ground, joined)
        features: list[Tensor] = []
        results: list[Tensor] = []
        for decoder in self.decoders:
            feature, result = decoder(joined)
            features.append(feature)
            results.append(_enlarged(result, size))
        class_logits: Tensor | None = None
        classes: Tensor | None = None
        sky: Tensor | None = None
        if self.class_decoder is not None:
            feature, result = self.class_decoder(joined)
            features.append(feature)
            logits = _enlarged(result, size)
            # Passes no gradient, as in the paper: classes are learned from classes.
            classes = logits.argmax(dim=1, keepdim=True)
            class_logits = logits
            sky = torch.softmax(logits.float(), dim=1)[:, self.sky_class : self.sky_class + 1]
        dense = self._fused(results, classes, ground)
        # Not in the paper; so that the depth is learned as without, nothing passes back into the decoders.
        confidence_logit = _enlarged(self.confidence(torch.cat([x.detach() for x in features], dim=1)), size)
        confidence = torch.sigmoid(confidence_logit)
        # Not blended between what a return reaches and what none does.
        coarse = functional.interpolate(self._metres(coarse_logit), size, mode="nearest")
        is_reached = functional.interpolate(reached.float(), size, mode="nearest") > 0
        semi_dense = self._near_returns(coarse, is_reached, dense, confidence)
        if self.cautious is not None and not self.training:
            dense = self.cautious(dense, confidence_logit, radar, valid, ground)
        if classes is not None:
            classes = classes.to(torch.uint8)
        depths = Depths(dense, semi_dense, self.calibrated(confidence_logit), classes, sky)
        return StructuredOutputs(depths, confidence_logit, coarse, is_reached, class_logits)

    def _fused(self, results: list[Tensor], classes: Tensor | None, ground: Tensor) -> Tensor:
        """One depth from the decoders' results, (B, 1, H, W) metres (section 3.4).

        Args:
            results: Logits of the depth's plane; then, with `ground_prior`, of the road's share in it; and of `conf`
                of the confidence. (B, values, H, W).
            classes: (B, 1, H, W) int64, of `seg`.
            ground: (B, 4).
        """
        # (B, decoders, values, H, W)
        values = torch.stack(results, dim=1)
        if self.weighs:
            # Deviation: the weights of a pixel sum up to 1, so that its depth stays within the range.
            shares = torch.softmax(values[:, :, -1], dim=1)
            depths = [self._depth(values[:, index], ground) for index in range(values.shape[1])]
            return (shares * torch.cat(depths, dim=1)).sum(dim=1, keepdim=True)
        if classes is not None:
            index = self.group_of_class[classes].unsqueeze(2).expand(-1, -1, values.shape[2], -1, -1)
            return self._depth(torch.gather(values, 1, index)[:, 0], ground)
        # Deviation: `add` sums before the depth is bounded; the sum of three bounded ones would leave the range.
        return self._depth(values.sum(dim=1), ground)

    def _near_returns(self, coarse: Tensor, reached: Tensor, dense: Tensor, confidence: Tensor) -> Tensor:
        """The semi-dense depth: the coarse one near returns, where it can be trusted; NaN elsewhere.

        The paper has none. The coarse depth knows no edges: it is a return's also beside the thing that sent it back.
        There the dense depth, which knows the image, differs.
        """
        found = torch.where(reached, coarse, torch.full_like(coarse, float("nan")))
        result: Tensor = self.trusted(found, dense, confidence)
        return result

    def _depth(self, logits: Tensor, ground: Tensor) -> Tensor:
        """Metres (B, 1, H, W) of a decoder's result (B, values, H, W)."""
        depth_m = self._metres(logits[:, :1])
        if self.ground is not None:
            depth_m = self.ground.blend(depth_m, logits[:, 1:2], ground)
        return depth_m

    def _metres(self, logit: Tensor) -> Tensor:
        # Deviation: the decoders' range is that of the logarithm of depth, as everywhere in this package.
        return plane_to_depth(torch.sigmoid(logit), self.min_depth_m, self.max_depth_m)


def _enlarged(x: Tensor, size: tuple[int, int]) -> Tensor:
    return functional.interpolate(x, size, mode="bilinear")
