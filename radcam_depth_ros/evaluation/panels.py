"""Pictures of frames: radar on the image, depth images on one colour scale, ground truth and errors."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.evaluation.baselines import spread_nearest
from radcam_depth_ros.evaluation.drive import Observation
from radcam_depth_ros.evaluation.metrics import EvaluationError
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame, ImageArray
from radcam_depth_ros.geometry import project
from radcam_depth_ros.messages import colorise
from radcam_depth_ros.resampling import rectify

NEAR_M, FAR_M = 2.0, 80.0
"""The colour scale of every depth image in a report, logarithmic."""
ERROR_M = 10.0
"""The colour scale of errors ends here, both ways."""
TILE_WIDTH = 800
"""Pictures are no wider than this."""
SPARSE_BELOW = 0.05
"""With less than this share of pixels known, as by LiDAR, a depth image is drawn as dots, so that it can be seen."""
_DOT_RADIUS = 1.6
_UNKNOWN_GREY = 34


@dataclass(frozen=True)
class Panel:
    """What a report shows of one frame; what is None is left out.

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
                raise EvaluationError(
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
class Tile:
    """One picture of a panel.

    Attributes:
        title: What it shows.
        scale: Its colour scale: "depth" or "error".
        image: (h, w, 3) uint8 RGB.
    """

    title: str
    scale: str
    image: ImageArray


def draw_panel(panel: Panel) -> tuple[Tile, ...]:
    """Draws all that a panel has, in reading order."""
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


def draw_radar(image: ImageArray, uv: FloatArray, depth_m: FloatArray) -> ImageArray:
    """Radar returns as dots in the colours of their depth on the image, (h, w, 3) uint8; the nearest on top."""
    scale = _scale(image)
    # A copy: an image may be a read-only view of its message, and it is drawn on.
    canvas = np.ascontiguousarray(_resize(image, cv2.INTER_AREA)).copy()
    seen = np.flatnonzero((depth_m > 0) & np.isfinite(uv).all(axis=1) & (np.abs(uv) < 1e5).all(axis=1))
    order = seen[np.argsort(-depth_m[seen])]
    if not len(order):
        return canvas
    colours = colorise(depth_m[order, None].astype(np.float32), NEAR_M, FAR_M)[:, 0]
    centres = np.round(uv[order] * scale).astype(int)
    radius = 4 if len(order) < 300 else 2
    for (column, row), colour in zip(centres.tolist(), colours.tolist(), strict=True):
        cv2.circle(canvas, (column, row), radius + 1, (0, 0, 0), -1, cv2.LINE_AA)
        cv2.circle(canvas, (column, row), radius, colour, -1, cv2.LINE_AA)
    return canvas


def draw_depth(depth_m: FloatArray) -> ImageArray:
    """A depth image in colours, (h, w, 3) uint8; dark grey where there is no value; sparse values are drawn as dots."""
    finite = np.where(np.isposinf(depth_m), np.float32(FAR_M), depth_m)
    small = _resize(_dots(finite), cv2.INTER_NEAREST)
    coloured = colorise(small, NEAR_M, FAR_M)
    coloured[np.isnan(small)] = _UNKNOWN_GREY
    return coloured


def draw_error(depth_m: FloatArray, truth_m: FloatArray) -> ImageArray:
    """Depth minus truth, (h, w, 3) uint8: red is too near, blue too far, white right, dark grey unknown."""
    known = (truth_m > 0) & np.isfinite(truth_m)
    error = np.full(depth_m.shape, np.nan, np.float32)
    error[known] = depth_m[known] - truth_m[known]
    return colour_error(_resize(_dots(error), cv2.INTER_NEAREST))


def colour_error(error_m: FloatArray) -> ImageArray:
    """The colours of errors, (H, W) float32 metres to (H, W, 3) uint8."""
    share = np.clip(error_m / np.float32(ERROR_M), -1.0, 1.0)
    white, near, far = np.array([245.0, 245, 245]), np.array([178.0, 24, 43]), np.array([33.0, 102, 172])
    strength = np.abs(np.nan_to_num(share))[..., None]
    colour = white + strength * (np.where(share[..., None] < 0, near, far) - white)
    colour[np.isnan(share)] = _UNKNOWN_GREY
    painted: ImageArray = colour.astype(np.uint8)
    return painted


class PanelKeeper:
    """Keeps a few evenly spaced frames of drives of any length, and the worst ones: a failure's picture says most.

    Pass `add` to `evaluate_drives` as its observer. No more than twice the number of panels are held at a time.

    Args:
        count: Number of evenly spaced frames.
        worst: Number of frames with the largest errors.
    """

    def __init__(self, count: int = 4, worst: int = 3) -> None:
        self._count, self._worst_count = count, worst
        self._seen, self._step = 0, 1
        self._kept: list[tuple[int, Observation]] = []
        self._worst: list[Observation] = []

    def add(self, observation: Observation) -> None:
        """Looks at a frame; frames come in order."""
        if math.isfinite(observation.mae_m):
            self._worst = heapq.nlargest(self._worst_count, [*self._worst, observation], key=lambda item: item.mae_m)
        if self._seen % self._step == 0 and self._count:
            self._kept.append((self._seen, observation))
        self._seen += 1
        if len(self._kept) > 2 * self._count:
            self._step *= 2
            self._kept = [kept for kept in self._kept if kept[0] % self._step == 0]

    def panels(self) -> tuple[Panel, ...]:
        """The frames that were kept, in their order, then the worst ones, the worst of all first."""
        picks = np.unique(np.linspace(0, len(self._kept) - 1, min(self._count, len(self._kept))).round().astype(int))
        panels = [_panel(self._kept[pick][1], "") for pick in picks]
        for place, observation in enumerate(self._worst):
            panels.append(_panel(observation, ", the worst" if not place else f", number {place + 1} of the worst"))
        return tuple(panels)


def _panel(observation: Observation, remark: str) -> Panel:
    frame, name = observation.sample.frame, observation.drive.name
    error = f", MAE {observation.mae_m:.2f} m" if math.isfinite(observation.mae_m) else ""
    place = f"frame {observation.index}{f' of {name}' if name else ''}"
    title = f"{place}, stamp {frame.stamp_ns / 1e9:.3f} s{error}{remark}"
    geometry_m = observation.baselines.get("ground_nearest")
    return Panel.of(title, frame, observation.result, observation.sample.depth_m, geometry_m)


def _scale(image: Any) -> float:
    return min(1.0, TILE_WIDTH / float(image.shape[1]))


def _resize(image: Any, interpolation: int) -> Any:
    scale = _scale(image)
    if scale == 1.0:
        return image
    size = (round(image.shape[1] * scale), max(1, round(image.shape[0] * scale)))
    return cv2.resize(image, size, interpolation=interpolation)


def _dots(values: FloatArray) -> FloatArray:
    """Sparse values as dots that survive the resizing; others as they are."""
    if np.isfinite(values).mean() >= SPARSE_BELOW:
        return values
    spread, distance_px = spread_nearest(values)
    dots: FloatArray = np.where(distance_px <= _DOT_RADIUS / _scale(values), spread, np.float32(np.nan))
    return dots
