from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import (
    BINS,
    MEASURES,
    DepthAccumulator,
    DepthRange,
    SemiDenseAccumulator,
    measure,
)

NAN, INF = np.nan, np.inf


def image(*values):
    return np.array([values], np.float32)


WITHIN_50_M = (DepthRange.within(50.0),)


def measured(prediction, truth, ranges=WITHIN_50_M):
    accumulator = DepthAccumulator(ranges)
    accumulator.add(image(*prediction), image(*truth))
    return accumulator.result()


def test_values_worked_out_by_hand():
    # Errors 2, 5, 0; ratios 1.2, 1.5, 1.
    (result,) = measured([12.0, 15.0, 20.0], [10.0, 10.0, 20.0])
    assert result.mae == pytest.approx(7 / 3)
    assert result.rmse == pytest.approx(math.sqrt(29 / 3))
    assert result.absrel == pytest.approx((0.2 + 0.5) / 3)
    assert result.log10 == pytest.approx((math.log10(1.2) + math.log10(1.5)) / 3, rel=1e-5)
    assert result.rmselog == pytest.approx(math.sqrt((math.log(1.2) ** 2 + math.log(1.5) ** 2) / 3), rel=1e-5)
    assert (result.d1, result.d2, result.d3) == pytest.approx((2 / 3, 1.0, 1.0))


@pytest.mark.parametrize(("ratio", "shares"), [(1.2, (1, 1, 1)), (1.3, (0, 1, 1)), (1.8, (0, 0, 1)), (2.0, (0, 0, 0))])
@pytest.mark.parametrize("is_far", [True, False])
def test_ratios_count_both_ways(ratio, shares, is_far):
    (result,) = measured([10 * ratio if is_far else 10 / ratio], [10.0])
    assert (result.d1, result.d2, result.d3) == shares


def test_predictions_are_clipped_to_the_range():
    ranges = (DepthRange.within(50.0), DepthRange.within(80.0), DepthRange.within(50.0, clip_m=80.0))
    within_50, within_80, clipped_at_80 = measured([INF, -3.0], [40.0, 10.0], ranges)
    assert within_50.mae == pytest.approx((10 + 10) / 2, rel=1e-3)
    assert within_80.mae == pytest.approx((40 + 10) / 2, rel=1e-3)
    assert clipped_at_80.mae == within_80.mae
    assert math.isfinite(within_50.rmselog)


def test_only_known_truth_in_range_counts():
    (result,) = measured([10.0] * 7, [NAN, INF, -INF, 0.0, -5.0, 50.001, 50.0])
    assert result.mae == pytest.approx(40.0)
    assert result.frames == 1


def test_a_missing_prediction_counts_as_the_farthest():
    (result,) = measured([NAN, 10.0], [10.0, 10.0])
    assert result.mae == pytest.approx(20.0)


def test_bins_hold_each_depth_once():
    depths = np.array([0.5, 10.0, 10.5, 30.0, 49.0, 50.0, 51.0, 100.0, 101.0], np.float32)
    held = [(depths > entry.lower_m) & (depths <= entry.upper_m) for entry in BINS]
    assert np.sum(held, axis=0).tolist() == [1] * 8 + [0]
    results = measured(depths + 1, depths, BINS)
    assert [entry.name for entry in results] == ["0-10", "10-30", "30-50", "50-100"]
    # The last one's 101 m is clipped to 100 m.
    assert [entry.mae for entry in results] == pytest.approx([1.0, 1.0, 1.0, 0.5])


def test_frames_weigh_the_same_however_many_pixels_they_have():
    accumulator = DepthAccumulator([DepthRange.within(50.0), DepthRange.within(5.0)])
    accumulator.add(image(11.0, 11.0, 11.0), image(10.0, 10.0, 10.0))
    accumulator.add(image(15.0, 10.0, 10.0), image(10.0, NAN, NAN))
    accumulator.add(image(15.0, 10.0, 10.0), image(NAN, NAN, NAN))
    within_50, within_5 = accumulator.result()
    assert within_50.mae == pytest.approx(3.0)
    assert within_50.rmse == pytest.approx(3.0)
    assert (within_50.frames, within_50.frames_without_truth) == (2, 1)
    assert (within_5.frames, within_5.frames_without_truth) == (0, 3)
    assert all(math.isnan(getattr(within_5, name)) for name in MEASURES)


def test_what_has_no_number_is_null_in_json():
    (result,) = measured([1.0], [NAN])
    plain = result.as_json()
    assert list(plain) == [*MEASURES, "frames", "frames_without_truth"]
    assert plain["mae"] is None
    assert plain["frames"] == 0


def test_a_frame_s_own_measures_are_given_back():
    accumulator = DepthAccumulator([DepthRange.within(50.0), DepthRange("far", 50.0, 80.0, 80.0)])
    own = accumulator.add(image(11.0), image(10.0))
    assert own.shape == (2, 8)
    assert own[0, 0] == pytest.approx(1.0)
    assert np.isnan(own[1]).all()


@settings(max_examples=50, deadline=None)
@given(
    pairs=st.lists(st.tuples(st.floats(0.5, 120, width=32), st.floats(0.5, 50, width=32)), min_size=1, max_size=30),
    scale=st.floats(0.5, 2, width=32),
)
def test_measures_agree_with_their_definitions(pairs, scale):
    prediction, truth = np.array(pairs, np.float32).T
    values = dict(zip(MEASURES, measure(prediction, truth, 50.0), strict=True))
    clipped = np.minimum(prediction, 50.0).astype(np.float64)
    error, ratio = np.abs(clipped - truth), np.maximum(clipped / truth, truth / clipped)
    assert values["mae"] == pytest.approx(error.mean(), rel=1e-4, abs=1e-5)
    assert values["rmse"] == pytest.approx(np.sqrt((error**2).mean()), rel=1e-4, abs=1e-5)
    assert values["mae"] <= values["rmse"] * (1 + 1e-6)
    assert values["log10"] == pytest.approx(np.log10(ratio).mean(), abs=1e-5)
    assert 0 <= values["d1"] <= values["d2"] <= values["d3"] <= 1
    # Scaling both scales metres, and leaves ratios alone.
    scaled = dict(zip(MEASURES, measure(prediction * scale, truth * scale, 50.0 * scale), strict=True))
    assert scaled["mae"] == pytest.approx(values["mae"] * scale, rel=1e-3, abs=1e-4)
    assert scaled["absrel"] == pytest.approx(values["absrel"], rel=1e-3, abs=1e-5)


def test_a_perfect_prediction_has_no_error():
    truth = np.linspace(0.5, 80, 100, dtype=np.float32)
    assert measure(truth, truth, 80.0) == pytest.approx([0, 0, 0, 0, 0, 1, 1, 1])


def test_semi_dense_counts_where_it_has_a_value():
    accumulator = SemiDenseAccumulator()
    accumulator.add(image(11.0, NAN, 60.0, NAN), image(10.0, 20.0, 62.0, NAN))
    accumulator.add(image(NAN, NAN, NAN, NAN), image(10.0, 20.0, 30.0, 40.0))
    accumulator.add(image(0.0, INF, -1.0, 5.0), image(10.0, 10.0, 10.0, NAN))
    result = accumulator.result()
    # Of the pixels with ground truth within 80 m; and of all.
    assert result.coverage == pytest.approx((2 / 3 + 0.0 + 0.0) / 3)
    assert result.image_share == pytest.approx((0.5 + 0.0 + 0.25) / 3)
    assert [entry.name for entry in result.metrics] == ["50", "70", "80"]
    assert [entry.mae for entry in result.metrics] == pytest.approx([1.0, 1.5, 1.5])
    assert [entry.frames for entry in result.metrics] == [1, 1, 1]
    plain = result.as_json()
    assert plain["coverage"] == pytest.approx(2 / 9)
    assert plain["image_share"] == pytest.approx(0.25)
    assert plain["mae"] == pytest.approx(1.5)
    assert plain["50"]["mae"] == pytest.approx(1.0)


def test_without_any_frame_there_is_no_number():
    assert math.isnan(SemiDenseAccumulator().result().coverage)
    assert math.isnan(DepthAccumulator().result()[0].mae)


@pytest.mark.parametrize("accumulator", [DepthAccumulator(), SemiDenseAccumulator()])
def test_images_of_different_size_are_refused(accumulator):
    with pytest.raises(EvaluationError, match=r"one size, got \(1, 2\) and \(1, 3\)"):
        accumulator.add(image(1.0, 2.0), image(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    "bounds", [(-1.0, 5.0, 5.0), (5.0, 5.0, 5.0), (0.0, INF, 5.0), (0.0, 5.0, 0.0), (0.0, NAN, 5.0)]
)
def test_impossible_ranges_are_refused(bounds):
    with pytest.raises(EvaluationError, match="a range needs"):
        DepthRange("odd", *bounds)
