"""Shares of the sky that is told and of what stands before it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radcam_depth_ros.classes import CLASS_NAMES, WIRE
from radcam_depth_ros.evaluation.measures.metrics import DepthRange
from radcam_depth_ros.evaluation.measures.sky import SkyAccumulator

TRUTH = np.array([[np.inf, np.inf, 10.0, 20.0], [np.nan, 90.0, 30.0, 40.0]], np.float32)
POLE = CLASS_NAMES.index("pole")
CLASSES = np.array([[10, 10, POLE, WIRE], [255, 2, WIRE, 2]], np.uint8)


def test_shares_are_of_all_pixels_of_all_frames() -> None:
    sums = SkyAccumulator(DepthRange.within(80.0))
    depth = np.full(TRUTH.shape, 50.0, np.float32)
    sky = np.array([[0.9, 0.2, 0.1, 0.5], [0.9, 0.9, 0.0, 0.0]], np.float32)
    sums.add(depth, sky, TRUTH, CLASSES)
    result = sums.result()
    assert (result.pixels, result.finite, result.kept) == (2, 0.5, 0.75)
    assert dict(result.thin) == {"poles": 1.0, "wires": 0.5}
    sums.add(depth, None, TRUTH)
    assert sums.result().finite == 0.75
    assert sums.result().kept == pytest.approx(7 / 8)


def test_infinite_depth_is_the_sky() -> None:
    sums = SkyAccumulator(DepthRange.within(80.0))
    sums.add(np.where(np.isinf(TRUTH), np.inf, np.float32(5.0)), None, TRUTH)
    assert (sums.result().finite, sums.result().kept) == (0.0, 1.0)


def test_without_any_sky_there_is_no_number() -> None:
    sums = SkyAccumulator(DepthRange.within(80.0))
    sums.add(np.ones((2, 2), np.float32), None, np.ones((2, 2), np.float32))
    result = sums.result()
    assert result.pixels == 0
    assert math.isnan(result.finite)
    assert result.as_json()["finite"] is None
