from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.evaluation.measures.distances import FARTHEST_M, STEP_M, DistanceAccumulator


def test_each_stretch_has_its_own_error():
    accumulator = DistanceAccumulator()
    truth = np.array([[1.0, 4.0, 12.0, 99.9, 100.0, np.nan, np.inf]], np.float32)
    accumulator.add(truth + np.array([1.0, 3.0, -4.0, 50.0, 1.0, 1.0, 1.0], np.float32), truth)
    accumulator.add(truth[:, :1] + 6, truth[:, :1])
    curve = accumulator.result()
    assert len(curve.mae_m) == len(curve.middles_m) == FARTHEST_M / STEP_M
    assert curve.middles_m[:2] == (2.5, 7.5)
    assert curve.mae_m[0] == pytest.approx((2.0 + 6.0) / 2)
    assert curve.mae_m[2] == pytest.approx(4.0)
    # Predictions are clipped to the curve's end.
    assert curve.mae_m[-1] == pytest.approx(0.1, abs=1e-4)
    plain = curve.as_json()
    assert [value is None for value in plain] == [False, True, False, *[True] * 16, False]
