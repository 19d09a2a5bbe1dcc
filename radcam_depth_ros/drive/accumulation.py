"""Accumulates many LiDAR scans into one depth image (d_acc of [Electronics2025] and [Singh2023]).

Scans before and after an image are moved to its time by the vehicle's motion. Left out is what moved, what the scan of
the image's time contradicts, and what shows through the gaps between nearer points. Where several points fall on a
pixel the nearest wins.
"""

from __future__ import annotations

import cv2
import numpy as np

from radcam_depth_ros.drive.range_view import Tolerance, Verdict
from radcam_depth_ros.drive.scans import Scan
from radcam_depth_ros.drive.settings import AccumulationConfig
from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.geometry import RigidTransform, depth_image

_OCCLUSION_FOCAL_LENGTH_PX = 630.0
_NEAREST_M = 0.5


def accumulate(
    nearest: Scan,
    scans: tuple[Scan, ...],
    world_from_camera: RigidTransform,
    camera: CameraModel,
    config: AccumulationConfig,
) -> FloatArray:
    """The depth image of many scans.

    Args:
        nearest: The scan nearest to the image, which says what is there at the image's time.
        scans: All scans around it, `nearest` too.
        world_from_camera: The camera's place at the image's time.
        camera: The camera.
        config: How.

    Returns:
        (H, W) float32 metres, NaN unknown.
    """
    tolerance = Tolerance(config.tolerance_m, config.tolerance_share)
    camera_from_world = world_from_camera.inverse()
    nearest_from_camera = nearest.world_from_scan.inverse() @ world_from_camera
    parts = [(camera_from_world @ nearest.world_from_scan).apply(nearest.points_m)]
    for scan in scans:
        camera_from_scan = camera_from_world @ scan.world_from_scan
        if scan is nearest or np.linalg.norm(camera_from_scan.translation) > config.window_m:
            continue
        points_m = _in_view(camera_from_scan.apply(scan.standing_m(scans, tolerance)), camera)
        verdict = nearest.view.check(nearest_from_camera.apply(points_m), tolerance)
        parts.append(points_m[(verdict != Verdict.SEEN_THROUGH) & (verdict != Verdict.HIDDEN)])
    depth_m = without_occluded(depth_image(np.concatenate(parts), camera), camera, config)
    if config.outlier_kernel_px:
        depth_m = without_outliers(depth_m, config.outlier_kernel_px, config.outlier_m)
    return interpolated(depth_m) if config.interpolate else depth_m


def without_occluded(depth_m: FloatArray, camera: CameraModel, config: AccumulationConfig) -> FloatArray:
    """Takes out pixels that show through the gaps of something nearer.

    Those have clearly nearer pixels on both sides, above and below or left and right. Nearer on one side alone is what
    a road has below it, and a wall beside a pole.
    """
    reach = config.occlusion_px * camera.fx / _OCCLUSION_FOCAL_LENGTH_PX
    rows, columns, aside = max(1, round(reach)), max(1, round(reach / 2)), max(1, round(reach / 8))
    known = np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
    in_front = (1 - 2 * config.tolerance_share) * known - 2 * config.tolerance_m
    # An erosion that is anchored at an end takes the minimum on one side. Beams lie closer beside one another than one
    # above the other, and a road is nearer in the row below: columns may be some pixels wide, rows may not.
    tall, wide = np.ones((rows + 1, 2 * aside + 1), np.uint8), np.ones((1, columns + 1), np.uint8)
    above, below = _minimum(known, tall, (aside, rows)), _minimum(known, tall, (aside, 0))
    left, right = _minimum(known, wide, (columns, 0)), _minimum(known, wide, (0, 0))
    behind = ((above < in_front) & (below < in_front)) | ((left < in_front) & (right < in_front))
    result = depth_m.copy()
    result[behind] = np.nan
    return result


def without_outliers(depth_m: FloatArray, kernel_px: int, threshold_m: float) -> FloatArray:
    """Takes out pixels that are farther than another one around them, as [Singh2023] filters accumulated scans.

    Args:
        depth_m: (H, W) float32 metres, NaN unknown.
        kernel_px: Width of the square around a pixel, odd.
        threshold_m: By how much farther.

    Returns:
        (H, W) float32 metres, NaN unknown.
    """
    known = np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
    middle = kernel_px // 2
    nearest = _minimum(known, np.ones((kernel_px, kernel_px), np.uint8), (middle, middle))
    return np.where(known - threshold_m > nearest, np.float32(np.nan), depth_m).astype(np.float32)


def interpolated(depth_m: FloatArray) -> FloatArray:
    """Depth between known pixels, linear in each triangle of their Delaunay triangulation; NaN outside of their hull.

    Args:
        depth_m: (H, W) float32 metres, NaN unknown.

    Returns:
        (H, W) float32 metres, NaN unknown; known pixels keep their depth.
    """
    from matplotlib.tri import LinearTriInterpolator, Triangulation  # here: it takes long, and few need it

    rows, columns = np.nonzero(np.isfinite(depth_m))
    # Of fewer than three pixels, or pixels on one line, there is no triangle.
    if len(rows) < 3 or np.linalg.matrix_rank(np.stack([rows - rows[0], columns - columns[0]])) < 2:
        return depth_m
    triangles = LinearTriInterpolator(Triangulation(columns, rows), depth_m[rows, columns].astype(np.float64))
    grid = np.meshgrid(np.arange(depth_m.shape[1]), np.arange(depth_m.shape[0]))
    filled = np.ma.filled(triangles(*grid), np.nan).astype(np.float32)
    return np.where(np.isfinite(depth_m), depth_m, filled)


def _minimum(values: FloatArray, kernel: np.ndarray, anchor: tuple[int, int]) -> FloatArray:
    return np.asarray(
        cv2.erode(values, kernel, anchor=anchor, borderType=cv2.BORDER_CONSTANT, borderValue=np.inf), np.float32
    )


def _in_view(points_m: FloatArray, camera: CameraModel) -> FloatArray:
    """The points (N, 3) in camera axes that fall on the image, or near enough to round to it."""
    x, y, z = points_m[:, 0], points_m[:, 1], points_m[:, 2]
    left, right = -(camera.cx + 1) / camera.fx, (camera.width - camera.cx) / camera.fx
    top, bottom = -(camera.cy + 1) / camera.fy, (camera.height - camera.cy) / camera.fy
    inside = (z > _NEAREST_M) & (x > left * z) & (x < right * z) & (y > top * z) & (y < bottom * z)
    return points_m[inside]
