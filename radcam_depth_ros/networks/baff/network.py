"""`baff`: radar-pixel association, bidirectional fusion and parallel attention.

Section and equation numbers in comments are those of [Electronics2025].
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from radcam_depth_ros.classes import CLASS_GROUPS
from radcam_depth_ros.networks.baff.agreement import Agreement
from radcam_depth_ros.networks.baff.association import FEATURES, OUTSIDE, EmbeddingAssociation, PointEncoder
from radcam_depth_ros.networks.baff.detail import enlarged
from radcam_depth_ros.networks.baff.geometry_mix import EMPHASIS, GeometryMix
from radcam_depth_ros.networks.baff.ground_refinement import RoadDoubt, RoadVotes
from radcam_depth_ros.networks.baff.head import Choice, QuarterFusion
from radcam_depth_ros.networks.baff.regions import RegionAssociation, check_region_width
from radcam_depth_ros.networks.baff.sky import SkyHead
from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.interface import Association, Candidates, Depths, Network, TrainOutputs, learns
from radcam_depth_ros.networks.layers.blocks import PlanarConv, QuarterEncoder
from radcam_depth_ros.networks.layers.caution import Caution, check_caution
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence
from radcam_depth_ros.networks.layers.image_statistics import FrameStatistics
from radcam_depth_ros.networks.layers.mobilenet import ContextEncoder
from radcam_depth_ros.networks.layers.rasterise import (
    PRIOR_PLANES,
    STRIDE,
    Geometry,
    Rasterise,
    depth_to_plane,
    plane_to_depth,
)
from radcam_depth_ros.networks.registry import register


class Roads(NamedTuple):
    """Planes of the road, (B, 1, h detail, w detail) each.

    told: As it was told or assumed.
    seen: As the image shows it.
    used: What the network takes for the road: a told one to the digit, an assumed one as the image shows it.
    deviation: Standard deviation of the logarithm of the depth of `seen`.
    heard: (B, 1), how much of the correction was made, 0 to 1.
    """

    told: Tensor
    seen: Tensor
    used: Tensor
    deviation: Tensor
    heard: Tensor


class Decision(NamedTuple):
    """What becomes of a choice.

    depths: As every network returns them.
    confidence_logit: (B, 1, H, W).
    geometry: (B, 1, h detail, w detail), the plane of geometry's depth.
    sky_logit: (B, 1, H / 2, W / 2), where the sky is told.
    """

    depths: Depths
    confidence_logit: Tensor
    geometry: Tensor
    sky_logit: Tensor | None


@dataclass(frozen=True)
class BaffConfig(NetworkConfig):
    """Architecture of `baff`.

    Attributes:
        association: `embedding` (one decoder pass however many returns) or `regions` (the paper's, one for each).
        threshold: tau, the score of `agreement.Agreement` above which a pixel of the semi-dense depth takes its
            return's depth.
        geometry_mix: Mix the dense depth with geometry's on the road as told, see `geometry_mix.GeometryMix`, and give
            the sky. A road that is told is then never corrected. False is the form of older weights.
        caution: Where the confidence is lower, the dense depth, after the mix if there is one, leans to geometry's: the
            nearest return, or the road where that is nearer. 0: nowhere.
        familiar: Share of sure pixels from which on depths of a picture do not lean, see `caution`. 0: of no picture.
        region_width_px: Width of a return's region of interest, a multiple of 32. The paper's 288 px at nuScenes'
            focal length of 1266 px are 143 px at 630 px, and 160 is the next multiple.
        embedding_dims: Learned part of the vectors of `embedding`.
        returns_per_cell: Returns that each cell of 32 x 32 pixels chooses between.
        radar_map_size: Rows and columns of the radar map of `regions`; the paper's (28, 9) for its larger image.
        channels: At 1/4, 1/8, 1/16, 1/32.
        blocks: Residual blocks of the image encoder at each of these.
        detail: Parts along each axis for which a depth is chosen within 4 pixels: 4 is the image's size.
        full_size: Correct the choice by a stem of the image at half its size, and enlarge the depth to the whole by
            learned weights, see `detail.Detail`; detail must be 2. False is the form of older weights, as is a
            `context` of `none`.
        bidirectional: The bottom-up branch (BF).
        channel_attention: CA.
        position_attention: PA.
        position_pool: How far keys and values are pooled at 1/8 and 1/16, as far as attention goes; 1 is exact.
        ground_prior: Take the flat road's depth as an input.
        context: `none`, or `mobilenet_v2`: its features of the image at half the size join the image encoder's, so that
            training can start from ImageNet's.
        instance_norm: Levels of the image encoder, finest first, whose norms go by each image's own statistics.
        road: Correct the flat road by what the image shows, see `road.RoadVotes`.
        hint: In training, tell the groups of classes of `classes.CLASS_GROUPS` as well, so that features know them.
    """

    association: str = "embedding"
    threshold: float = 0.25
    geometry_mix: bool = True
    caution: float = 0.7
    familiar: float = 0.38
    region_width_px: int = 160
    embedding_dims: int = 32
    returns_per_cell: int = 8
    radar_map_size: tuple[int, int] = (14, 5)
    channels: tuple[int, int, int, int] = (32, 64, 128, 192)
    blocks: tuple[int, int, int, int] = (1, 2, 2, 2)
    detail: int = 2
    full_size: bool = True
    bidirectional: bool = True
    channel_attention: bool = True
    position_attention: bool = True
    position_pool: tuple[int, ...] = (16, 8)
    ground_prior: bool = True
    road: bool = True
    hint: bool = True
    instance_norm: int = 2
    context: str = "mobilenet_v2"
    focal_length_px: float = 630.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_caution(self.caution, self.familiar)
        if self.association not in ("embedding", "regions"):
            raise ArchitectureError(f"association must be 'embedding' or 'regions', got {self.association!r}")
        if not 0 <= self.instance_norm <= 4:
            raise ArchitectureError(f"instance_norm must be 0 to 4 levels, got {self.instance_norm}")
        if self.context not in ("none", "mobilenet_v2"):
            raise ArchitectureError(f"context must be 'none' or 'mobilenet_v2', got {self.context!r}")
        check_region_width(self.region_width_px)
        if self.detail not in (1, 2, 4):
            raise ArchitectureError(f"detail must be 1, 2 or 4, got {self.detail}")
        if self.full_size and self.detail != 2:
            raise ArchitectureError(f"detail must be 2 with full_size: true, got {self.detail}")
        if len(self.position_pool) != 2 or min(self.position_pool) < 1:
            raise ArchitectureError(f"position_pool needs 2 whole numbers from 1 on, got {self.position_pool}")
        if min(*self.channels, *self.blocks, self.returns_per_cell, self.embedding_dims) < 1:
            raise ArchitectureError("channels, blocks, returns_per_cell and embedding_dims must be at least 1")


@register("baff")
class Baff(Network):
    """Both stages; see `interface` for what it takes and gives."""

    about = "association, then attention fusion (Electronics 2025)"
    config_type = BaffConfig
    stride: Final[int] = STRIDE
    parts = ("context", "encoder", "association", "road", "doubt", "fusion", "hint", "sky", "mix")
    sections = (
        ("rasterise", "rasterise"),
        ("ImageNet's features", "context"),
        ("image encoder", "encoder"),
        ("association", "association"),
        ("road", "road"),
        ("depth encoder", "fusion.depth_encoder"),
        ("gates", "fusion.gates"),
        ("bidirectional fusion", "fusion.bidirectional"),
        *((f"attention 1/{16 >> index}", f"fusion.refinement.attention.{index}") for index in range(2)),
        *(("refinement", f"fusion.refinement.up.{index}") for index in range(2)),
        ("head", "fusion.head"),
        ("detail", "fusion.fine"),
        ("sky", "sky"),
        ("mix with geometry", "mix"),
    )
    backbones = ("context",)
    adjustable = ("threshold", "calibration", "caution", "familiar")
    grows = MappingProxyType({"geometry_mix": False, "full_size": False, "context": "none", "hint": False})
    paper_network = "baff_paper"

    def __init__(self, config: BaffConfig) -> None:
        super().__init__(config)
        self.calibrated = CalibratedConfidence(config.calibration)
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.agreement = Agreement(config.threshold, config.min_depth_m)
        self.caution = Caution(config.caution, config.familiar)
        self.outside = OUTSIDE
        self.detail = config.detail
        self.emphasis = EMPHASIS
        points = PointEncoder(config.focal_length_px, config.min_depth_m, config.max_depth_m)
        features = FEATURES[2]
        if config.association == "embedding":
            self.association: EmbeddingAssociation | RegionAssociation = EmbeddingAssociation(
                config.channels, points, config.embedding_dims, config.region_width_px, config.returns_per_cell
            )
        else:
            self.association = RegionAssociation(points, config.region_width_px, config.radar_map_size)
            features = self.association.features
        ablation = (config.bidirectional, config.channel_attention, config.position_attention)
        self.rasterise = Rasterise(
            config.min_depth_m, config.max_depth_m, config.ground_prior, config.returns_per_cell, config.detail
        )
        widths = ContextEncoder.CHANNELS if config.context != "none" else ()
        self.encoder = QuarterEncoder(PRIOR_PLANES, config.channels, config.blocks, widths, config.instance_norm)
        self.context = ContextEncoder() if config.context != "none" else None
        self.keeps_told = config.geometry_mix
        self.statistics = FrameStatistics()
        has_road = config.road and config.ground_prior
        self.road = RoadVotes(config.channels) if has_road else None
        self.doubt = RoadDoubt() if has_road and config.geometry_mix else None
        self.fusion = QuarterFusion(
            config.channels, features, config.position_pool, *ablation, config.detail, config.full_size
        )
        self.hint = PlanarConv(config.channels[0], torch.zeros(len(CLASS_GROUPS))) if config.hint else None
        self.sky = SkyHead(config.channels) if config.geometry_mix else None
        self.mix = GeometryMix(config.channels[0], config.detail) if config.geometry_mix else None

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        geometry = self.rasterise(radar, valid, ground, image.shape[2], image.shape[3])
        maps = self.encoder(image, geometry.prior, self._context(image))
        best, depth, features = self.association(image, maps, radar, valid)
        statistics = self.statistics(image, valid)
        roads = self._roads(maps, ground, statistics, image)
        choice = self._choose(image, maps, features, best, depth, geometry, roads.used)
        return self._decide(image, maps, statistics, geometry, roads, best, depth, choice).depths

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> TrainOutputs:
        """The forward pass with what the losses need.

        Stage 2 takes stage 1's depth as it stands, and its choice of the strongest return passes no gradient back, as
        in the paper; the image's features learn from both.
        """
        geometry = self.rasterise(radar, valid, ground, image.shape[2], image.shape[3])
        maps = self.encoder(image, geometry.prior, self._context(image))
        statistics = self.statistics(image, valid)
        roads = self._roads(maps, ground, statistics, image)
        association: Association | None = None
        if learns(self.association):
            association, best, depth, features = self.association.train_outputs(image, maps, radar, valid)
        else:
            best, depth, features = self.association(image, maps, radar, valid)
        others = (self.fusion, self.road, self.doubt, self.sky, self.mix)
        if not any(part is not None and learns(part) for part in others):
            return TrainOutputs(None, None, association, None, None)
        choice = self._choose(image, maps, features, best, depth, geometry, roads.used)
        decision = self._decide(image, maps, statistics, geometry, roads, best, depth, choice)
        logits, planes = self.fusion.hypotheses(choice)
        outputs = TrainOutputs(
            decision.depths,
            decision.confidence_logit,
            association,
            Candidates(logits, self._depth(planes)) if learns(self.fusion) else None,
            self._depth(roads.seen),
        )
        if self.hint is not None and learns(self.hint):
            outputs = outputs._replace(group_logits=self.hint(choice.features))
        if self.mix is None:
            return outputs
        return outputs._replace(
            own_m=self._depth(choice.plane),
            geometry_m=self._depth(decision.geometry),
            sky_logit=decision.sky_logit,
            told_m=self._depth(roads.told),
            road_deviation=roads.deviation,
            heard=None if self.doubt is None else roads.heard,
        )

    def _context(self, image: Tensor) -> list[Tensor]:
        maps: list[Tensor] = []
        if self.context is not None:
            maps = self.context(image)
        return maps

    def _roads(self, maps: list[Tensor], ground: Tensor, statistics: Tensor, image: Tensor) -> Roads:
        """The road as it is told, seen and used."""
        told = self._drawn(ground, image)
        if self.road is None:
            return Roads(told, told, told, torch.zeros_like(told), torch.ones_like(ground[:, :1]))
        # Not of the statistics: without doubt and mix nothing needs them, and freezing leaves them out.
        heard, variance = torch.ones_like(ground[:, :1]), torch.ones_like(ground[0, :1])
        if self.doubt is not None:
            heard, variance = self.doubt(statistics)
        ground_seen, covariance = self.road(maps, ground, heard)
        covariance = variance * covariance
        seen = self._drawn(ground_seen, image)
        used = seen
        if self.keeps_told:
            used = torch.where(ground[:, 3:].unsqueeze(2).unsqueeze(3) > 0.5, told, seen)
        deviation = self.road.deviation(covariance, ground, self._depth(seen), self.stride / self.detail)
        return Roads(told, seen, used, deviation, heard)

    def _drawn(self, ground: Tensor, image: Tensor) -> Tensor:
        """A road's plane (B, 1, h detail, w detail)."""
        road: Tensor = self.rasterise.road(ground, image.shape[2], image.shape[3])
        return road

    def _choose(
        self,
        image: Tensor,
        maps: list[Tensor],
        features: Tensor,
        best: Tensor,
        depth: Tensor,
        geometry: Geometry,
        road: Tensor,
    ) -> Choice:
        """Stage 2 at a quarter: the choice between depths."""
        rows = features.shape[2]
        # Of regions, which work at the image's size, one pixel stands for its cell: depths are not blended.
        step = best.shape[2] // rows
        best, depth = (
            best[:, :, step // 2 :: step, step // 2 :: step],
            depth[:, :, step // 2 :: step, step // 2 :: step],
        )
        probability = self._probability(best)
        found = depth_to_plane(depth, self.min_depth_m, self.max_depth_m)
        found = torch.where(best > 0.5 * self.outside, found, torch.ones_like(found))
        # The probability, not whether it passes tau: a plane that is 0 everywhere, as that would be before stage 1 has
        # learned anything, has no variance, and each batch norm on its way multiplies the gradient by 300.
        # Deviation: what is likelier than not, whatever tau is, so that tau can be set after the training.
        likely = torch.where(probability > 0.5, found, torch.zeros_like(found))
        known = torch.cat([likely, probability, geometry.drawn], dim=1)
        suggested = torch.cat([geometry.nearest, geometry.layers, found], dim=1)
        choice: Choice = self.fusion(image, maps, features, known, road, suggested, geometry.profile)
        return choice

    def _decide(
        self,
        image: Tensor,
        maps: list[Tensor],
        statistics: Tensor,
        geometry: Geometry,
        roads: Roads,
        best: Tensor,
        depth: Tensor,
        choice: Choice,
    ) -> Decision:
        """The dense depth of the network's and geometry's, its confidence, and the sky, all at the image's size."""
        plane, confidence_logit, near = choice.plane, choice.confidence_logit, choice.near
        sky_logit: Tensor | None = None
        sky: Tensor | None = None
        if self.mix is not None and self.sky is not None:
            own = functional.avg_pool2d(plane.float(), self.detail)
            sure = torch.sigmoid(functional.avg_pool2d(confidence_logit.float(), self.detail))
            shown = torch.cat([geometry.prior[:, :1], own, sure], dim=1).detach()
            sky_logit = self.sky(image, maps, choice.features, shown)
            nearest = functional.interpolate(geometry.nearest, scale_factor=float(self.detail))
            near, used = torch.minimum(roads.told, nearest), torch.minimum(roads.used, nearest).detach()
            planes = [
                geometry.prior,
                sure,
                self.emphasis * functional.avg_pool2d(roads.seen - roads.told, self.detail),
                self.emphasis * functional.avg_pool2d(roads.deviation, self.detail),
                torch.sigmoid(functional.avg_pool2d(sky_logit, 2)),
            ]
            # What the other parts learn is theirs: the mix takes it as it stands.
            known = torch.cat([values.detach().float() for values in planes], dim=1)
            plane, confidence_logit = self.mix(statistics, choice.features, known, plane, confidence_logit, near, used)
            sky = torch.sigmoid(sky_logit)
        semi_dense = self.agreement(
            self._probability(best), depth, self._depth(plane.detach()), confidence_logit.detach()
        )
        if not self.training:
            plane = self.caution(plane, confidence_logit, near)
        size = (image.shape[2], image.shape[3])
        if self.fusion.fine is not None:
            plane = enlarged(plane, choice.weights)
        elif self.detail < self.stride:
            plane = functional.interpolate(plane, size, mode="bilinear")
        if self.detail < self.stride:
            confidence_logit = functional.interpolate(confidence_logit, size, mode="bilinear")
        semi_dense = functional.interpolate(semi_dense, size, mode="nearest")
        depths = Depths(self._depth(plane), semi_dense, self.calibrated(confidence_logit), None, sky)
        return Decision(depths, confidence_logit, near, sky_logit)

    def _probability(self, best: Tensor) -> Tensor:
        """Of stage 1's return."""
        return torch.sigmoid(best.detach().float())

    def _depth(self, plane: Tensor) -> Tensor:
        return plane_to_depth(plane, self.min_depth_m, self.max_depth_m)
