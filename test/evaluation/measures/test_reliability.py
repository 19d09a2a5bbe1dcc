from __future__ import annotations

import json
import math

import numpy as np
import pytest

from radcam_depth_ros.evaluation.measures.metrics import RANGES
from radcam_depth_ros.evaluation.measures.reliability import BINS, Calibration, ReliabilityAccumulator

TRUTH_M = 20.0


def measured(*frames, **options):
    """Calibration of frames that are lists of (confidence, is it right)."""
    sums = ReliabilityAccumulator(RANGES[-1])
    for pixels in frames:
        confidence = np.array([[value for value, _ in pixels]], np.float32)
        depth_m = np.array([[TRUTH_M if right else 2 * TRUTH_M for _, right in pixels]], np.float32)
        sums.add(depth_m, confidence, np.full(depth_m.shape, TRUTH_M, np.float32), **options)
    return sums.result()


def test_bins_have_what_was_predicted_and_observed():
    overall = measured([(0.05, False), (0.72, True), (0.78, False), (1.0, True)]).overall
    low, high, highest = overall.bins[0], overall.bins[7], overall.bins[9]
    assert (low.pixels, low.share, low.observed) == (1, 0.25, 0.0)
    assert (high.pixels, high.share, high.observed) == (2, 0.5, 0.5)
    assert (high.lower, high.upper, high.predicted) == pytest.approx((0.7, 0.8, 0.75))
    assert (highest.pixels, highest.predicted, highest.observed) == (1, 1.0, 1.0)
    assert overall.bins[3].pixels == 0
    assert math.isnan(overall.bins[3].predicted)
    assert overall.ece == pytest.approx(0.25 * 0.05 + 0.5 * 0.25 + 0.25 * 0.0)


def test_a_threshold_leaves_the_bins_above_it():
    result = measured([(0.05, False), (0.72, True), (0.78, False), (1.0, True)])
    found = {round(entry.min_confidence, 1): (entry.left, entry.right) for entry in result.overall.thresholds}
    assert found[0.0] == (1.0, 0.5)
    assert found[0.1] == found[0.7] == pytest.approx((0.75, 2 / 3))
    assert found[0.9] == (0.25, 1.0)
    assert result.as_json()["thresholds"][9] == {"min_confidence": 0.9, "left": 0.25, "right": 1.0}
    none_is_sure = measured([(0.05, True)]).overall.thresholds[3]
    assert none_is_sure.left == 0.0
    assert none_is_sure.as_json()["right"] is None


def test_a_calibrated_confidence_has_no_error():
    pixels = [(tenth / 10 + 0.05, place < 2 * tenth + 1) for tenth in range(BINS) for place in range(20)]
    overall = measured(pixels).overall
    assert overall.pixels == 200
    assert overall.ece == pytest.approx(0.0, abs=1e-6)
    assert overall.largest_fall == 0.0


def test_all_pixels_of_all_frames_count_alike():
    apart = measured([(0.9, True)], [(0.9, False), (0.9, False), (0.9, False)]).overall
    assert apart.ece == pytest.approx(0.9 - 0.25, abs=1e-6)


def test_right_is_nearer_than_a_tenth_of_the_truth_and_infinity_is_wrong():
    sums = ReliabilityAccumulator(RANGES[-1])
    depth_m = np.array([[21.9, 22.1, 18.1, 17.9, np.inf, 85.0]], np.float32)
    truth_m = np.array([[20, 20, 20, 20, 20, 80]], np.float32)
    sums.add(depth_m, np.full(depth_m.shape, 0.5, np.float32), truth_m)
    assert sums.result().overall.bins[5].observed == pytest.approx(3 / 6)


def test_pixels_without_truth_or_confidence_are_left_out():
    sums = ReliabilityAccumulator(RANGES[-1])
    truth_m = np.array([[np.nan, np.inf, 81, 0, 20, 20]], np.float32)
    confidence = np.array([[1, 1, 1, 1, np.nan, 0.3]], np.float32)
    sums.add(np.full(truth_m.shape, 20, np.float32), confidence, truth_m)
    result = sums.result()
    assert result.overall.pixels == 1
    assert result.overall.ece == pytest.approx(0.7)
    assert result.by_surface == {}
    assert result.by_time_of_day == {}


def test_the_largest_fall_leaves_small_bins_out():
    # 1000 pixels: observed 0.8, 0.5 and 0.9; a bin of 4 pixels that are all wrong would be the largest fall.
    pixels = [(0.15, place < 160) for place in range(200)] + [(0.45, place < 150) for place in range(300)]
    pixels += [(0.95, place < 446) for place in range(496)]
    small = [(0.75, False)] * 4
    overall = measured(pixels + small).overall
    assert overall.largest_fall == pytest.approx(0.3)
    assert overall.bins[7].observed == 0.0
    enough = measured(pixels + 2 * small).overall
    assert enough.largest_fall == pytest.approx(0.5)
    assert measured([(0.5, True)]).overall.largest_fall == 0.0


def test_parts_of_the_pixels_are_told_apart():
    sums = ReliabilityAccumulator(RANGES[-1])
    truth_m = np.array([[10, 20, 30, 60, 80]], np.float32)
    depth_m = np.array([[10, 40, 30, 20, 80]], np.float32)
    classes = np.array([[0, 0, 13, 1, 255]], np.uint8)
    ones = np.ones(truth_m.shape, np.float32)
    sums.add(depth_m, ones, truth_m, classes, "day")
    sums.add(depth_m[:, :1], ones[:, :1], truth_m[:, :1], None, "night")
    sums.add(depth_m[:, 1:2], ones[:, 1:2], truth_m[:, 1:2])
    result = sums.result()
    assert {name: (part.pixels, part.ece) for name, part in result.by_distance.items()} == {
        "0-20": (4, 0.5),
        "20-50": (1, 0.0),
        "50-80": (2, 0.5),
    }
    assert {name: (part.pixels, part.ece) for name, part in result.by_surface.items()} == {
        "road": (2, 0.5),
        "not road": (2, 0.5),
    }
    assert {name: part.pixels for name, part in result.by_time_of_day.items()} == {"day": 5, "night": 1}
    assert result.by_time_of_day["day"].ece == pytest.approx(0.4)
    assert result.overall.pixels == 7


def test_the_json_has_numbers_or_null():
    plain = json.loads(json.dumps(measured([(0.72, True)], time_of_day="dusk").as_json(), allow_nan=False))
    assert plain["ece"] == pytest.approx(0.28)
    assert (plain["within_m"], plain["pixels"], plain["largest_fall"]) == (80.0, 1, 0.0)
    assert len(plain["bins"]) == BINS
    assert plain["bins"][7]["share"] == 1.0
    assert plain["bins"][0]["predicted"] is None
    assert plain["by_time_of_day"]["dusk"]["ece"] == plain["ece"]
    assert plain["by_range"]["50-80"] == {"pixels": 0, "ece": None, "largest_fall": None}


def test_without_pixels_there_is_no_number():
    empty = Calibration.of(np.zeros((3, BINS)))
    assert math.isnan(empty.ece)
    assert math.isnan(empty.largest_fall)
    assert empty.as_json() == {"pixels": 0, "ece": None, "largest_fall": None}
