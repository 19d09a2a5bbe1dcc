"""A frame's pictures side by side: radar on the image, depth, ground truth and errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.frame import DepthResult, FloatArray, Frame, ImageArray
from radcam_depth_ros.geometry import project
from radcam_depth_ros.reporting.errors import ReportError
from radcam_depth_ros.reporting.pictures import draw_depth, draw_error, draw_radar
from radcam_depth_ros.resampling import rectify


@dataclass(frozen=True)
class Panel:
    """Images and depth of one frame; None is not shown.

    Attributes:
        title: Above it.
        image: (H, W, 3) uint8 RGB.
        radar_uv: (N, 2) float32 pixels.
        radar_depth_m: (N,) float32 metres.
        semi_dense: (H, W) float32 metres, NaN where there is no value.
        dense: (H, W) float32 metres.
        ground_truth: (H, W) float32 metres, NaN where unknown, +inf beyond the range.
        geometry: (H, W) float32 metres, depth from geometry alone.
    """

    title: str
    image: ImageArray
    radar_uv: FloatArray
    radar_depth_m: FloatArray
    semi_dense: FloatArray | None = None
    dense: FloatArray | None = None
    ground_truth: FloatArray | None = None
    geometry: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("semi_dense", "dense", "ground_truth", "geometry"):
            depth = getattr(self, name)
            if depth is not None and depth.shape != self.image.shape[:2]:
                raise ReportError(
                    f"{name} of a panel must be {self.image.shape[:2]} like its image, got {depth.shape}; resample it"
                )

    @classmethod
    def of(
        cls,
        title: str,
        frame: Frame,
        result: DepthResult | None,
        ground_truth: FloatArray | None = None,
        geometry: FloatArray | None = None,
    ) -> Panel:
        """A panel of a frame and its depth, both of one size."""
        uv, depth_m = project(frame.radar.xyz_m, frame.camera)
        known = None if ground_truth is None or np.isnan(ground_truth).all() else ground_truth
        semi_dense, dense = (None, None) if result is None else (result.semi_dense, result.dense)
        image = rectify(frame.image, frame.camera, frame.lens)
        return cls(title, image, uv, depth_m, semi_dense, dense, known, geometry)


@dataclass(frozen=True)
class Highlight:
    """A frame that stands at the top of a report.

    Attributes:
        title: Why it does, such as "the worst frame".
        panel: The frame.
    """

    title: str
    panel: Panel


@dataclass(frozen=True)
class Tile:
    """One picture of a panel.

    Attributes:
        title: Above it.
        scale: Its colour scale: "depth" or "error".
        image: (h, w, 3) uint8 RGB.
    """

    title: str
    scale: str
    image: ImageArray


def draw_panel(panel: Panel) -> tuple[Tile, ...]:
    """Draws the pictures of a panel, in reading order."""
    tiles = [Tile("camera and radar", "depth", draw_radar(panel.image, panel.radar_uv, panel.radar_depth_m))]
    depths = (
        ("semi-dense depth", panel.semi_dense),
        ("dense depth", panel.dense),
        ("ground truth", panel.ground_truth),
    )
    tiles += [Tile(title, "depth", draw_depth(depth)) for title, depth in depths if depth is not None]
    if panel.ground_truth is not None:
        for title, depth in (("error of the dense depth", panel.dense), ("error of geometry alone", panel.geometry)):
            if depth is not None:
                tiles.append(Tile(title, "error", draw_error(depth, panel.ground_truth)))
    return tuple(tiles)
