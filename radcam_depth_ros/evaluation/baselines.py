"""Baselines that a network is compared with.

`camera_only` is the network without radar returns. `radar_interpolation` uses the returns alone. `ground_nearest` takes
the flat road or, where that is closer, the radar return nearest in the image; above the horizon the return alone. Where
the camera's height is not known, a level camera at `ASSUMED_HEIGHT_M` is assumed.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

from radcam_depth_ros.frame import ASSUMED_HEIGHT_M, CameraModel, FloatArray, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.geometry import depth_image, ground_coefficients
from radcam_depth_ros.resampling import spread_nearest

BASELINES = ("ground_nearest", "camera_only", "radar_interpolation")
FARTHEST_M = 100.0
"""Depth of the sky and of the road beyond: the far end of the networks' depth range, metres."""
CELLS_ACROSS = 400
"""Cells of `radar_interpolation`."""
INTERPOLATION_POWER = 4.0
"""In `radar_interpolation` a return's weight falls with the distance in pixels to this power."""


def known_or_assumed_ground(frame: Frame, height_m: float | None = None) -> GroundPlane:
    """The frame's road; where its height is not known, with the given height or `ASSUMED_HEIGHT_M`."""
    if frame.ground.is_known:
        return frame.ground
    return dataclasses.replace(frame.ground, height_m=ASSUMED_HEIGHT_M if height_m is None else height_m)


def flat_road(camera: CameraModel, ground: GroundPlane) -> FloatArray:
    """Depth of the flat road, whose height must be known: (H, W) float32 metres, (0, `FARTHEST_M`]."""
    a, b, c, _ = ground_coefficients(ground, camera)
    columns = a * np.arange(camera.width, dtype=np.float32)
    rows = b * np.arange(camera.height, dtype=np.float32) + c
    inverse = columns[None, :] + rows[:, None]
    road: FloatArray = np.reciprocal(np.maximum(inverse, np.float32(1.0 / FARTHEST_M)))
    return road


def nearest_return(frame: Frame) -> FloatArray:
    """The depth of the radar return nearest in the image, (H, W) float32 metres; all NaN when none is in view."""
    return spread_nearest(depth_image(frame.radar.xyz_m, frame.camera))[0]


def without_radar(frame: Frame) -> Frame:
    """The frame without radar returns, for `camera_only`."""
    return dataclasses.replace(frame, radar=RadarReturns.empty(), radar_counts=(0,) * len(frame.radar_counts))


def radar_interpolation(frame: Frame) -> FloatArray:
    """Depth between the projected returns: the mean of their inverse depths, weighted by distance in the image.

    Shepard's interpolation, as two convolutions, so that its cost does not depend on the number of returns. It is done
    in cells, `CELLS_ACROSS` along the image's longer side; the nearest return of a cell counts. Inverse depth is linear
    in the image over any plane.

    Returns:
        (H, W) float32 metres; `FARTHEST_M` where no return is in view.
    """
    camera = frame.camera
    scale = min(1.0, CELLS_ACROSS / max(camera.width, camera.height))
    width, height = max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
    known = depth_image(frame.radar.xyz_m, camera.resized(width, height))
    is_known = np.isfinite(known)
    if not is_known.any():
        return np.full((camera.height, camera.width), FARTHEST_M, np.float32)
    # Twice the size, so that the far ends do not meet: a convolution by Fourier's transform is circular.
    shape = (2 * height, 2 * width)
    rows, columns = (np.minimum(np.arange(size), size - np.arange(size)) for size in shape)
    kernel = np.fft.rfft2(1.0 / (0.25 + rows[:, None] ** 2 + columns[None, :] ** 2) ** (INTERPOLATION_POWER / 2))
    values = np.stack([np.where(is_known, 1.0 / known, 0.0), is_known.astype(np.float64)])
    total, weight = np.fft.irfft2(np.fft.rfft2(values, shape) * kernel, shape)[:, :height, :width]
    # The transform's rounding must not lead beyond the returns.
    inverse = np.clip(total / weight, 1.0 / known[is_known].max(), 1.0 / known[is_known].min())
    depth = (1.0 / inverse).astype(np.float32)
    size = (camera.width, camera.height)
    enlarged: FloatArray = cv2.resize(depth, size, interpolation=cv2.INTER_LINEAR)
    return enlarged


def ground_nearest(frame: Frame, height_m: float | None = None) -> FloatArray:
    """The flat road or the radar return nearest in the image, whichever is closer; without returns, the flat road.

    Args:
        frame: The frame; its image is not used.
        height_m: The camera's height above the road where the frame does not know it.

    Returns:
        (H, W) float32 metres, (0, `FARTHEST_M`].
    """
    road = flat_road(frame.camera, known_or_assumed_ground(frame, height_m))
    # fmin leaves out the NaN of "no return in view". Above the horizon the road is at FARTHEST_M: the return wins.
    closer: FloatArray = np.fmin(road, nearest_return(frame))
    return closer
