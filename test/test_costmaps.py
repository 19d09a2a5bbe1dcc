"""What the points mark and clear by the heights and ranges of config/nav2/costmaps.yaml, as nav2's layers apply them.

nav2 itself is in no package registry. Its rules are those of `ObservationBuffer::bufferCloud` and
`VoxelLayer::updateBounds` of Jazzy: a point counts for a source, to mark and to clear, when its height is within the
source's; it marks when it is within its obstacle range as well.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from radcam_depth_ros.bags import factory
from radcam_depth_ros.encoder import Encoder, OutputConfig
from radcam_depth_ros.frame import CameraModel, DepthResult, FloatArray, Frame, RadarReturns
from radcam_depth_ros.geometry import unproject
from radcam_depth_ros.messages import decode_points

ROOT = Path(__file__).parents[1]
CAMERA = CameraModel(160, 90, 130.0, 130.0, 79.5, 44.5)
HEIGHT_M = 1.4
WALL_M = 10.0
"""A wall across the left half of the image, 2 m high."""


def scene() -> tuple[FloatArray, FloatArray, FloatArray, dict[str, Any]]:
    """Depth, sky and confidence of a road, a wall and the sky above; and which pixels show what."""
    rows = np.arange(CAMERA.height)[:, None] + np.zeros((1, CAMERA.width))
    columns = np.arange(CAMERA.width)[None, :] + np.zeros((CAMERA.height, 1))
    down = (rows - CAMERA.cy) / CAMERA.fy
    with np.errstate(divide="ignore"):
        road_m = np.where(down > 0, HEIGHT_M / np.maximum(down, 1e-9), np.inf)
    heights_m = HEIGHT_M - WALL_M * down
    is_wall = (columns < CAMERA.width / 2) & (heights_m >= 0) & (heights_m <= 2.0)
    is_sky = ~is_wall & (road_m > 80)
    doubtful = (columns >= CAMERA.width * 3 / 4) & is_sky
    # As a network without a sky would have it: a wall of doubtful depth where the sky is.
    depth = np.where(is_wall, WALL_M, np.where(is_sky, 14.0, road_m)).astype(np.float32)
    confidence = np.where(doubtful, 0.05, 0.9).astype(np.float32)
    sky = np.where(is_sky & ~doubtful, 0.9, 0.0).astype(np.float32)
    return depth, sky, confidence, {"wall": is_wall, "road": ~is_wall & ~is_sky, "sky": is_sky}


def cloud_of(config: OutputConfig) -> Any:
    depth, sky, confidence, _ = scene()
    image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    frame = Frame(5, "camera", image, CAMERA, RadarReturns.empty())
    result = DepthResult(5, "camera", CAMERA, depth, depth, confidence, 0, None, sky)
    return Encoder(config, factory).encode(frame, result, ("points",))["points"]


def used_by(source: dict[str, Any], xyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The points that a source's marking and clearing take, of points in the camera's axes."""
    heights = HEIGHT_M - xyz[:, 1]
    taken = xyz[(heights >= source["min_obstacle_height"]) & (heights <= source["max_obstacle_height"])]
    distances = np.linalg.norm(taken, axis=1)
    reach = (distances >= source.get("obstacle_min_range", 0.0)) & (distances < source.get("obstacle_max_range", 2.5))
    return taken[reach] if source["marking"] else taken[:0], taken if source["clearing"] else taken[:0]


@pytest.mark.parametrize("is_organized", [False, True])
def test_the_wall_marks_the_road_clears_and_neither_sky_nor_doubt_does_anything(is_organized: bool) -> None:
    sections = yaml.safe_load((ROOT / "config" / "nav2" / "costmaps.yaml").read_text(encoding="utf-8"))
    layer = sections["local_costmap"]["local_costmap"]["ros__parameters"]["depth_layer"]
    xyz = decode_points(cloud_of(OutputConfig(points_organized=is_organized))).xyz_m
    shown = scene()[3]
    points = {name: unproject(scene()[0], CAMERA)[is_shown] for name, is_shown in shown.items()}
    marking, clearing = used_by(layer["dense"], xyz)
    high_enough = HEIGHT_M - points["wall"][:, 1] >= layer["dense"]["min_obstacle_height"]
    assert len(marking) == np.count_nonzero(high_enough) > 100
    np.testing.assert_allclose(marking[:, 2], WALL_M, rtol=1e-5)
    assert len(clearing) == len(marking), "the road clears nothing by the source that marks"
    marking, clearing = used_by(layer["free"], xyz)
    assert len(marking) == 0
    assert len(clearing) == len(points["road"]) + len(points["wall"]), "nor do sky and doubt"


def test_without_thresholds_doubt_would_mark() -> None:
    sections = yaml.safe_load((ROOT / "config" / "nav2" / "costmaps.yaml").read_text(encoding="utf-8"))
    dense = sections["local_costmap"]["local_costmap"]["ros__parameters"]["depth_layer"]["dense"]
    marking, _ = used_by(dense, decode_points(cloud_of(OutputConfig(points_min_confidence=0.0))).xyz_m)
    assert (np.abs(marking[:, 2] - 14.0) < 0.1).any()
