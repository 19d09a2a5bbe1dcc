"""The inverse of `geometry.project`, for tests."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.frame import CameraModel, FloatArray


def unproject(depth_m: FloatArray, camera: CameraModel) -> FloatArray:
    """The point of each pixel: depth (H, W) metres along z to (H, W, 3) float32 in camera axes, NaN where depth is."""
    height, width = depth_m.shape
    x = (np.arange(width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (np.arange(height, dtype=np.float32) - np.float32(camera.cy)) / np.float32(camera.fy)
    return np.stack([depth_m * x[None, :], depth_m * y[:, None], depth_m], axis=-1).astype(np.float32, copy=False)
