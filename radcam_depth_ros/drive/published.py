"""The depth image of one LiDAR scan as published evaluations on nuScenes draw it."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import DoubleArray

_NEAREST_M = 1.0
_MARGIN_PX = 1.0
_STEPS = 256
"""Steps of a metre: depth is stored in 16-bit images of this scale."""


def published_depth(points_m: FloatArray | DoubleArray, camera: CameraModel) -> FloatArray:
    """Draws points: beyond 1 m and more than 1 px inside of the image, rounded, the last one of a pixel stays.

    Args:
        points_m: (N, 3) in camera axes, metres.
        camera: The camera.

    Returns:
        (H, W) float32 metres in whole steps of 1/256 m, rounded down; NaN unknown.
    """
    x, y, z = np.asarray(points_m, np.float64).T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    kept = (z > _NEAREST_M) & (u > _MARGIN_PX) & (u < camera.width - _MARGIN_PX)
    kept &= (v > _MARGIN_PX) & (v < camera.height - _MARGIN_PX)
    column, row = np.round(u[kept]).astype(np.int64), np.round(v[kept]).astype(np.int64)
    image = np.full((camera.height, camera.width), np.nan, np.float32)
    # Of indices that come several times numpy keeps the last value.
    image[row, column] = np.floor(z[kept] * _STEPS) / _STEPS
    return image
