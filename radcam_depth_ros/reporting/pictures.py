"""Draws depth, errors and radar returns as RGB pictures, on the colour scales that all reports share."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.messages import colorise
from radcam_depth_ros.reporting.errors import ReportError
from radcam_depth_ros.resampling import spread_nearest

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
DEPTH_TICKS_M = (2, 5, 10, 20, 40, 80)
"""Labels of the colour scale of depth."""
BACKGROUND, TEXT = 24, (225, 225, 225)
"""Grey around pictures, and the colour of text on it."""


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


def encode(image: ImageArray, extension: str = ".png") -> bytes:
    """The file of an RGB image (H, W, 3) uint8, ".png" or ".jpg"."""
    done, data = cv2.imencode(extension, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not done:
        raise ReportError(f"an image of {image.shape[1]} x {image.shape[0]} pixels cannot be written as {extension}")
    return data.tobytes()


def scale_share(depth_m: float) -> float:
    """Place of a depth on the colour scale: 0 at `NEAR_M`, 1 at `FAR_M`."""
    return math.log(depth_m / NEAR_M) / math.log(FAR_M / NEAR_M)


def draw_depth_scale(bar: Any, left: int, right: int, rows: int) -> tuple[int, ...]:
    """Draws the colour scale of depth and its tick marks into a bar.

    Args:
        bar: (h, w, 3) uint8, drawn on; the colours begin at row 4, four rows of tick marks follow.
        left: First column of the scale.
        right: Column after its last.
        rows: Height of the colours.

    Returns:
        The columns of `DEPTH_TICKS_M`.
    """
    colours_m = np.geomspace(NEAR_M, FAR_M, right - left, dtype=np.float32)[None]
    bar[4 : 4 + rows, left:right] = colorise(colours_m, NEAR_M, FAR_M)
    columns = tuple(left + round(scale_share(tick_m) * (right - left - 1)) for tick_m in DEPTH_TICKS_M)
    for column in columns:
        bar[4 + rows : 8 + rows, column] = TEXT
    return columns


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
