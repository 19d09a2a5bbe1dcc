"""Draws one frame: camera, dense and semi-dense depth side by side, with radar returns."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.encoder import image_at
from radcam_depth_ros.frame import DepthResult, Frame, ImageArray, RadcamDepthError
from radcam_depth_ros.geometry import project
from radcam_depth_ros.reporting.pictures import (
    BACKGROUND,
    DEPTH_TICKS_M,
    TEXT,
    draw_depth,
    draw_depth_scale,
    draw_radar,
)

TILES = 3
SMALLEST_WIDTH = 480
_CAPTION_PX, _FOOTER_PX, _GAP_PX = 26, 40, 4
_FONT, _FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5


class ViewError(RadcamDepthError):
    """Pictures that cannot be made, or not be written where they should go."""


def draw_picture(frame: Frame, result: DepthResult, width: int) -> ImageArray:
    """Draws a frame.

    Args:
        frame: The frame.
        result: Its depth, at any size.
        width: Of the picture; a few pixels are left out so that videos have even sizes.

    Returns:
        (h, w, 3) uint8 RGB, h and w even.

    Raises:
        ViewError: when it is too narrow to be read.
    """
    if width < SMALLEST_WIDTH:
        raise ViewError(f"a picture needs a width of at least {SMALLEST_WIDTH} pixels, got {width}")
    uv, depth_m = project(frame.radar.xyz_m, result.camera)
    camera = draw_radar(image_at(frame, result.camera), uv, depth_m)
    dense = draw_depth(result.dense)
    shrunk = dense.shape[1] / result.camera.width
    dense = draw_radar(dense, uv * np.float32(shrunk), depth_m)
    titles = ("camera and radar", "dense depth", "semi-dense depth")
    tiles = [
        _tile(title, tile, width // TILES - _GAP_PX)
        for title, tile in zip(titles, (camera, dense, draw_depth(result.semi_dense)), strict=True)
    ]
    row = np.concatenate(tiles, axis=1)
    picture = np.concatenate([row, _footer(frame, row.shape[1])])
    height, width = (size // 2 * 2 for size in picture.shape[:2])
    return np.ascontiguousarray(picture[:height, :width])


def _tile(title: str, image: ImageArray, width: int) -> ImageArray:
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    enlarged = width > image.shape[1]
    resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST if enlarged else cv2.INTER_AREA)
    tile = np.full((_CAPTION_PX + height, width + _GAP_PX, 3), BACKGROUND, np.uint8)
    _write(tile[:_CAPTION_PX], title, 6)
    tile[_CAPTION_PX:, :width] = resized
    return tile


def _footer(frame: Frame, width: int) -> ImageArray:
    """Stamp and returns on the left, the colours of depth on the right."""
    footer = np.full((_FOOTER_PX, width, 3), BACKGROUND, np.uint8)
    _write(footer, f"{frame.stamp_ns / 1e9:.3f} s, {len(frame.radar)} radar returns", 6)
    left, right = width - width // TILES + 10, width - 30
    columns = draw_depth_scale(footer, left, right, rows=12)
    free = width  # columns that no number has yet
    for tick_m, column in reversed(tuple(zip(DEPTH_TICKS_M, columns, strict=True))):
        text = f"{tick_m} m" if tick_m == DEPTH_TICKS_M[-1] else str(tick_m)
        start = column - 4 * len(text)
        if start + 8 * len(text) <= free:
            cv2.putText(footer, text, (start, 34), _FONT, 0.4, TEXT, 1, cv2.LINE_AA)
            free = start - 4
    return footer


def _write(canvas: Any, text: str, left: int) -> None:
    baseline = canvas.shape[0] // 2 + 5
    cv2.putText(canvas, text, (left, baseline), _FONT, _FONT_SCALE, TEXT, 1, cv2.LINE_AA)
