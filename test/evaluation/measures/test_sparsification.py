from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.evaluation.measures.metrics import DepthAccumulator, DepthRange
from radcam_depth_ros.evaluation.measures.sparsification import REMOVED, SparsificationAccumulator, SparsificationCurve

WITHIN_80_M = DepthRange.within(80.0)


def sparsified(*frames):
    accumulator = SparsificationAccumulator(WITHIN_80_M)
    for depth, confidence, truth in frames:
        accumulator.add(*(np.asarray(image, np.float32)[None] for image in (depth, confidence, truth)))
    return accumulator.result()


def frame(seed, count=400):
    generator = np.random.default_rng(seed)
    truth = generator.uniform(1, 80, count)
    return truth + generator.normal(0, 5, count), generator.uniform(0, 1, count), truth


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([20, 60, 400]))
def test_curves_are_means_of_what_is_left(seed, count):
    depth, _, truth = frame(seed, count)
    # Apart by more than the accumulator tells apart.
    confidence = np.random.default_rng(seed).permutation(count) / count
    error = np.abs(np.clip(depth, 1e-3, 80) - truth)
    result = sparsified((depth, confidence, truth))
    for order, mae, rmse in (
        (np.argsort(confidence), result.mae.by_confidence, result.rmse.by_confidence),
        (np.argsort(-error), result.mae.oracle, result.rmse.oracle),
    ):
        left = [error[order][round(share * count) :] for share in REMOVED]
        np.testing.assert_allclose(mae, [values.mean() for values in left], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(rmse, [np.sqrt((values**2).mean()) for values in left], rtol=1e-4, atol=1e-5)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), levels=st.integers(1, 5))
def test_no_order_is_better_than_the_oracle_s(seed, levels):
    depth, confidence, truth = frame(seed)
    result = sparsified((depth, np.round(confidence * levels) / levels, truth))
    for curve in (result.mae, result.rmse):
        assert (np.subtract(curve.by_confidence, curve.oracle) >= -1e-5).all()
        assert (np.diff(curve.oracle) <= 1e-9).all()
        assert curve.by_confidence[0] == pytest.approx(curve.oracle[0])
        assert curve.ause_m >= 0


def test_a_confidence_that_knows_the_error_is_the_oracle():
    depth, _, truth = frame(1)
    error = np.abs(np.clip(depth, 1e-3, 80) - truth)
    curve = sparsified((depth, 1 - error / error.max(), truth)).mae
    assert curve.ause_m == pytest.approx(0.0, abs=1e-3)
    assert curve.falls
    assert curve.rise_m == 0.0
    backwards = sparsified((depth, error / error.max(), truth)).mae
    assert not backwards.falls
    assert backwards.rise_m > 0.1
    assert backwards.ause_m > 10 * curve.ause_m


def test_pixels_of_one_confidence_have_no_order():
    depth, _, truth = frame(2)
    truth, depth = np.sort(truth), depth[np.argsort(truth)]
    curve = sparsified((depth, np.full_like(truth, 0.3), truth)).mae
    np.testing.assert_allclose(curve.by_confidence, curve.by_confidence[0], rtol=1e-6)


def test_a_confidence_that_is_no_number_is_the_least():
    curve = sparsified(([12.0, 10.0], [math.nan, 0.2], [10.0, 10.0])).mae
    assert curve.by_confidence[0] == pytest.approx(1.0)
    assert curve.by_confidence[10:] == pytest.approx([0.0] * 10)


def test_frames_are_averaged_and_start_at_the_table_s_error():
    frames = [frame(seed) for seed in range(3)]
    nothing = (np.ones(4), np.ones(4), np.array([math.nan, math.inf, 0.0, 81.0]))
    result = sparsified(*frames, nothing)
    accumulator = DepthAccumulator([WITHIN_80_M])
    for depth, _, truth in frames:
        accumulator.add(np.float32(depth), np.float32(truth))
    (expected,) = accumulator.result()
    assert result.frames == 3
    assert result.mae.by_confidence[0] == pytest.approx(expected.mae, rel=1e-5)
    assert result.rmse.by_confidence[0] == pytest.approx(expected.rmse, rel=1e-5)
    plain = result.as_json()
    assert plain["removed"] == list(REMOVED)
    assert len(plain["mae"]["by_confidence"]) == len(plain["mae"]["oracle"]) == 20


def test_without_ground_truth_there_is_no_number():
    plain = sparsified().as_json()
    assert plain["frames"] == 0
    assert plain["mae"]["ause"] is None
    assert plain["mae"]["falls"] is False


def test_the_area_is_that_between_the_curves():
    curve = SparsificationCurve((2.0,) * 20, tuple(2.0 - share for share in REMOVED))
    assert curve.ause_m == pytest.approx(0.95**2 / 2)
