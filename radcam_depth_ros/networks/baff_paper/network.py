"""`baff_paper`: the paper's form of `baff`, a decoder pass for each return and depth by regression.

"Depth Estimation Based on MMwave Radar and Camera Fusion with Attention Mechanisms and Multi-Scale Features for
Autonomous Driving Vehicles", Electronics 2025. It is the reference for speed.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from radcam_depth_ros.networks.baff.association import PointEncoder
from radcam_depth_ros.networks.baff.regions import RegionAssociation, check_region_width
from radcam_depth_ros.networks.baff_paper.fusion import PaperFusion
from radcam_depth_ros.networks.config import ArchitectureError, NetworkConfig
from radcam_depth_ros.networks.interface import Association, Depths, Network, TrainOutputs, learns
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence
from radcam_depth_ros.networks.layers.rasterise import depth_to_plane, plane_to_depth
from radcam_depth_ros.networks.registry import register


@dataclass(frozen=True)
class BaffPaperConfig(NetworkConfig):
    """Architecture of `baff_paper`.

    Attributes:
        threshold: tau, stage 1's confidence from which on a pixel of the semi-dense depth takes its return's depth.
        region_width_px: Width of a return's region of interest, a multiple of 32.
        radar_map_size: Rows and columns of the radar map.
        bidirectional: The bottom-up branch (BF).
        channel_attention: CA.
        position_attention: PA.
        position_pool: How far keys and values of PA are pooled at 1/2, 1/4, 1/8 and 1/16. 1 is the paper's exact form,
            which takes minutes at 1/2.
    """

    threshold: float = 0.5
    region_width_px: int = 288
    radar_map_size: tuple[int, int] = (28, 9)
    bidirectional: bool = True
    channel_attention: bool = True
    position_attention: bool = True
    position_pool: tuple[int, ...] = (16, 8, 4, 1)
    focal_length_px: float = 630.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_region_width(self.region_width_px)
        if len(self.position_pool) != 4 or min(self.position_pool) < 1:
            raise ArchitectureError(f"position_pool needs 4 whole numbers from 1 on, got {self.position_pool}")


@register("baff_paper")
class BaffPaper(Network):
    """Both stages; see `interface` for what it takes and gives."""

    about = "baff in its paper's form, the reference for speed (Electronics 2025)"
    config_type = BaffPaperConfig
    parts = ("association", "fusion")
    sections = (
        ("association", "association"),
        ("image encoder", "fusion.image_encoder"),
        ("depth encoder", "fusion.depth_encoder"),
        ("gates", "fusion.gates"),
        ("bidirectional fusion", "fusion.bidirectional"),
        *((f"attention 1/{16 >> index}", f"fusion.refinement.attention.{index}") for index in range(4)),
        *(("refinement", f"fusion.refinement.up.{index}") for index in range(3)),
        ("head", "fusion.head"),
    )
    adjustable = (
        "threshold",
        "calibration",
    )
    trained_like = "baff"

    def __init__(self, config: BaffPaperConfig) -> None:
        super().__init__(config)
        self.calibrated = CalibratedConfidence(config.calibration)
        self.min_depth_m = config.min_depth_m
        self.max_depth_m = config.max_depth_m
        self.threshold = config.threshold
        points = PointEncoder(config.focal_length_px, config.min_depth_m, config.max_depth_m)
        self.association = RegionAssociation(points, config.region_width_px, config.radar_map_size)
        self.fusion = PaperFusion(
            config.position_pool, config.bidirectional, config.channel_attention, config.position_attention
        )

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        best, depth, _ = self.association(image, [image], radar, valid)
        return self._regress(image, best, depth)[0]

    @torch.jit.unused
    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> TrainOutputs:
        """The forward pass with what the losses need; stage 2 passes no gradient back to stage 1, as in the paper."""
        association: Association | None = None
        if learns(self.association):
            association, best, depth, _ = self.association.train_outputs(image, [image], radar, valid)
        else:
            best, depth, _ = self.association(image, [image], radar, valid)
        if not learns(self.fusion):
            return TrainOutputs(None, None, association, None, None)
        return TrainOutputs(*self._regress(image, best, depth), association, None, None)

    def _regress(self, image: Tensor, best: Tensor, depth: Tensor) -> tuple[Depths, Tensor]:
        """Stage 2: depths and the confidence's logit, from stage 1's greatest logits and their returns' depths."""
        probability = torch.sigmoid(best.detach().float())
        associated = probability > self.threshold
        plane = depth_to_plane(depth, self.min_depth_m, self.max_depth_m)
        known = torch.cat([torch.where(associated, plane, torch.zeros_like(plane)), probability], dim=1)
        raw = self.fusion(image, known.to(image.dtype))
        dense = plane_to_depth(torch.sigmoid(raw[:, :1]), self.min_depth_m, self.max_depth_m)
        semi_dense = torch.where(associated, depth, torch.full_like(depth, float("nan")))
        return Depths(dense, semi_dense, self.calibrated(raw[:, 1:])), raw[:, 1:]
