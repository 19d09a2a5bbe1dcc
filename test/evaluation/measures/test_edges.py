"""Errors near edges of the exact depth and away from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radcam_depth_ros.evaluation.measures.edges import EDGE_RATIO, NEAR_PX, EdgeAccumulator, near_edges
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import RANGES, measure

NAN, SKY = np.nan, np.inf


def columns(*depths_m, width=30, height=20):
    """(height, width * len(depths_m)) float32: blocks of one depth, side by side."""
    return np.repeat(np.array(depths_m, np.float32), width)[None].repeat(height, axis=0)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("left_m", "right_m", "is_edge"),
    [
        *((10.0, 11.4, False), (10.0, 11.6, True), (11.6, 10.0, True)),
        *((10.0, SKY, True), (SKY, 10.0, True), (SKY, SKY, False)),
        *((10.0, NAN, False), (NAN, SKY, False), (NAN, NAN, False)),
    ],
)
def test_an_edge_is_a_step_of_depth_or_the_end_of_the_sky(left_m, right_m, is_edge, turned):
    truth = columns(left_m, right_m)
    near = near_edges(np.ascontiguousarray(truth.T)).T if turned else near_edges(truth)
    # Pixels 29 and 30 are beside the edge.
    expected = np.zeros(60, bool)
    expected[29 - NEAR_PX : 30 + NEAR_PX + 1] = is_edge
    assert near.dtype == np.bool_
    assert (near == expected).all()


def test_near_is_a_disc_around_the_pixels_beside_an_edge():
    truth = np.full((61, 61), 20.0, np.float32)
    truth[30, 30] = 10.0
    row, column = np.mgrid[:61, :61] - 30
    beside = [(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)]
    distance = np.min([np.hypot(row - down, column - right) for down, right in beside], axis=0)
    assert (near_edges(truth) == (distance <= NEAR_PX)).all()


def test_a_slope_has_no_edges():
    slope = np.cumprod(np.full(20, np.float32(EDGE_RATIO - 0.01)))[None].repeat(20, axis=0)
    assert not near_edges(slope).any()


def test_errors_near_edges_and_away_are_apart():
    sums = EdgeAccumulator()
    truth = columns(10.0, 60.0, 90.0, width=100)
    depth = truth + np.where(near_edges(truth), np.float32(3.0), np.float32(1.0))
    sums.add(depth, truth)
    result = sums.result()
    assert result.frames == 1
    assert [entry.name for entry in result.near] == [entry.name for entry in result.away] == ["50", "70", "80"]
    assert [entry.mae for entry in result.near] == pytest.approx([3.0] * 3)
    assert [entry.rmse for entry in result.away] == pytest.approx([1.0] * 3)
    # Of 200 columns within 80 m, 9 on each side of the first step and 9 before the second.
    assert result.share == pytest.approx(27 / 200)


def test_both_parts_together_are_the_whole():
    generator = np.random.default_rng(0)
    truth = columns(*generator.uniform(5, 45, 12)) * generator.uniform(0.99, 1.01, (20, 360)).astype(np.float32)
    depth = generator.uniform(1, 50, truth.shape).astype(np.float32)
    sums = EdgeAccumulator()
    sums.add(depth, truth)
    result = sums.result()
    whole = measure(depth.ravel(), truth.ravel(), RANGES[0].clip_m)[0]
    assert result.share * result.near[0].mae + (1 - result.share) * result.away[0].mae == pytest.approx(whole)


def test_frames_are_averaged_and_those_without_truth_are_left_out():
    sums = EdgeAccumulator()
    for truth in (columns(10.0, 20.0, width=9), columns(10.0, 10.0, width=9), columns(NAN, SKY)):
        sums.add(truth + 1, truth)
    result = sums.result()
    assert (result.frames, result.share) == (3, 0.5)
    assert (result.near[-1].frames, result.near[-1].frames_without_truth) == (1, 2)
    assert (result.away[-1].frames, result.away[-1].frames_without_truth) == (1, 2)


def test_without_truth_there_is_no_number():
    sums = EdgeAccumulator()
    sums.add(np.ones((4, 4), np.float32), np.full((4, 4), NAN, np.float32))
    plain = sums.result().as_json()
    assert math.isnan(sums.result().share)
    assert list(plain) == ["50", "70", "80", "share", "away"]
    assert plain["share"] is None
    assert plain["50"]["mae"] is None


def test_images_of_different_sizes_are_refused():
    with pytest.raises(EvaluationError, match="one size"):
        EdgeAccumulator().add(np.ones((4, 4), np.float32), np.ones((4, 5), np.float32))
