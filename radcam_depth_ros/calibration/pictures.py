"""Draws radar returns and LiDAR points over images."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.calibration.evidence import in_image, thinned
from radcam_depth_ros.calibration.recording import Recording, View
from radcam_depth_ros.frame import FloatArray, GroundPlane, ImageArray
from radcam_depth_ros.geometry import ground_coefficients, project
from radcam_depth_ros.reporting.pictures import (
    BACKGROUND,
    DEPTH_TICKS_M,
    TEXT,
    TILE_WIDTH,
    draw_depth_scale,
    draw_radar,
)
from radcam_depth_ros.resampling import rectify

_ROAD_LINES_M = (10.0, 20.0, 40.0)
_HALF_LANE_M = 1.75
_MOST_DRAWN = 3000
_LEAST_WIDTH = 640
_BAR_PX, _TITLE_PX = 34, 24
_HORIZON, _ROAD = (255, 255, 255), (255, 0, 255)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_view(recording: Recording, view: View) -> ImageArray:
    """An image once for each sensor, one below the other, with depth as colour, the horizon and the flat road.

    Returns:
        (h, w, 3) uint8 RGB.
    """
    image = rectify(view.frame.image, view.frame.camera, view.frame.lens)
    tiles = []
    for radar, points_m in zip(recording.radars, view.radar_m, strict=True):
        tiles += _tile(radar.topic, "returns", image, view, radar.camera_from_radar.apply(points_m))
    if view.lidar_m is not None and recording.camera_from_lidar is not None:
        points_m = recording.camera_from_lidar.apply(view.lidar_m)
        tiles += _tile(recording.topics.lidar or "LiDAR", "points", image, view, points_m)
    tiles.append(_scale(tiles[0].shape[1], view.frame.ground))
    picture: ImageArray = np.concatenate(tiles)
    return picture


def _tile(topic: str, what: str, image: ImageArray, view: View, points_m: FloatArray) -> list[ImageArray]:
    camera = view.frame.camera
    uv, depth_m = project(points_m, camera)
    larger = max(1, round(_LEAST_WIDTH / camera.width))
    seen = np.flatnonzero(in_image(points_m, camera))
    seen = thinned(seen, _MOST_DRAWN)
    enlarged = cv2.resize(image, None, fx=larger, fy=larger, interpolation=cv2.INTER_NEAREST)
    canvas = draw_radar(np.asarray(enlarged, np.uint8), uv[seen] * np.float32(larger), depth_m[seen])
    _draw_road(canvas, view)
    title: Any = np.full((_TITLE_PX, canvas.shape[1], 3), BACKGROUND, np.uint8)
    share = len(np.flatnonzero(in_image(points_m, camera))) / max(1, len(points_m))
    behind = float((depth_m <= 0).mean()) if len(points_m) else 0.0
    words = f"{topic}: {len(points_m)} {what}, {share:.0%} in the image, {behind:.0%} behind the camera"
    cv2.putText(title, words, (6, 17), _FONT, 0.45, TEXT, 1, cv2.LINE_AA)
    return [title, canvas]


def _draw_road(canvas: ImageArray, view: View) -> None:
    camera = view.frame.camera
    ground = view.frame.ground.or_assumed()
    shrunk = canvas.shape[1] / camera.width
    a, b, c, _ = (float(value) for value in ground_coefficients(ground, camera))
    if abs(b) < 1e-9:
        return
    ends = [(0.0, -c / b), (float(camera.width), -(a * camera.width + c) / b)]
    (left, right) = ((round(u * shrunk), round(float(np.clip(v, -1e4, 1e4)) * shrunk)) for u, v in ends)
    cv2.line(canvas, left, right, _HORIZON, 1, cv2.LINE_AA)
    for depth_m in _ROAD_LINES_M:
        line = []
        for x_m in (-_HALF_LANE_M, _HALF_LANE_M):
            u = camera.fx * x_m / depth_m + camera.cx
            line.append((round(u * shrunk), round((1 / depth_m - a * u - c) / b * shrunk)))
        cv2.line(canvas, line[0], line[1], _ROAD, 1, cv2.LINE_AA)
        cv2.putText(canvas, f"{depth_m:.0f} m", (line[1][0] + 3, line[1][1] + 4), _FONT, 0.35, _ROAD, 1, cv2.LINE_AA)


def _scale(width: int, ground: GroundPlane) -> ImageArray:
    bar: Any = np.full((_BAR_PX, width, 3), BACKGROUND, np.uint8)
    left, right = width // 2, width - 30
    for tick_m, place in zip(DEPTH_TICKS_M, draw_depth_scale(bar, left, right, rows=10), strict=True):
        cv2.putText(bar, str(tick_m), (place - 4 * len(str(tick_m)), 30), _FONT, 0.38, TEXT, 1, cv2.LINE_AA)
    road = "the flat road" if ground.is_known else "the road as assumed: 1.4 m below a level camera"
    if width >= TILE_WIDTH // 2:
        cv2.putText(bar, f"depth in m; white: horizon, violet: {road}", (6, 20), _FONT, 0.36, TEXT, 1, cv2.LINE_AA)
    return np.asarray(bar, np.uint8)
