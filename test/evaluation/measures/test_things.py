"""Errors of small things by distance."""

from __future__ import annotations

import json

import numpy as np
import pytest

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.evaluation.measures.things import STRETCHES, THINGS, ThingAccumulator, things_json

PERSON, POLE, CAR, ROAD = (CLASS_NAMES.index(name) for name in ("person", "pole", "car", "road"))


def test_each_class_has_its_errors_by_distance():
    sums = ThingAccumulator(80.0)
    truth = np.array([[10.0, 10.1, 15.0, 79.0, 80.1, np.inf, np.nan, 5.0]], np.float32)
    error = np.array([[0.5, 1.0, 3.0, 9.0, 7.0, 7.0, 7.0, 7.0]], np.float32)
    classes = np.array([[PERSON] * 7 + [ROAD]], np.uint8)
    sums.add(truth + error, truth, classes)
    person = sums.result()["person"]
    assert list(sums.result()) == ["person"]
    assert list(person) == ["80", *STRETCHES]
    assert {name: entry.pixels for name, entry in person.items() if entry.pixels} == {
        **{"80": 4, "0-10": 1},
        **{"10-20": 2, "50-80": 1},
    }
    # Predictions are clipped to 80 m.
    assert person["50-80"].mae_m == pytest.approx(1.0)
    assert person["10-20"].mae_m == pytest.approx(2.0)
    assert person["80"].mae_m == pytest.approx((0.5 + 1.0 + 3.0 + 1.0) / 4)
    assert person["80"].median_m == pytest.approx(1.0, rel=0.01)
    assert person["20-30"].as_json() == {"mae": None, "median": None, "pixels": 0}


@pytest.mark.parametrize("seed", range(5))
def test_the_median_is_within_half_a_percent(seed):
    generator = np.random.default_rng(seed)
    error = np.exp(generator.normal(0.0, 2.0, (11, 101))).astype(np.float32)
    sums = ThingAccumulator(5000.0)
    sums.add(error + 20, np.full(error.shape, 20.0, np.float32), np.full(error.shape, POLE, np.uint8))
    entry = sums.result()["pole"]["10-20"]
    # An odd number of pixels; the sum with 20 m rounds, too.
    assert entry.median_m == pytest.approx(np.median(error), rel=0.0051)
    assert entry.mae_m == pytest.approx(error.mean(), rel=1e-4)


def test_errors_beyond_the_histogram_count_as_its_ends():
    sums = ThingAccumulator(5000.0)
    truth, classes = np.full((1, 2), 20.0, np.float32), np.array([[PERSON, CAR]], np.uint8)
    sums.add(np.array([[20.0, 4000.0]], np.float32), truth, classes)
    result = sums.result()
    assert result["person"]["80"].median_m == pytest.approx(0.001, rel=0.01)
    assert result["car"]["80"].median_m == pytest.approx(1000.0, rel=0.02)
    assert result["car"]["80"].mae_m == pytest.approx(3980.0)


def test_parts_of_the_pixels_add_up_to_the_whole():
    generator = np.random.default_rng(1)
    truth = generator.uniform(1, 90, (40, 60)).astype(np.float32)
    depth = truth + generator.normal(0, 3, truth.shape).astype(np.float32)
    classes = generator.integers(0, len(CLASS_NAMES), truth.shape).astype(np.uint8)
    whole, parts = ThingAccumulator(80.0), ThingAccumulator(80.0)
    whole.add(depth, truth, classes)
    for rows in (slice(0, 7), slice(7, 30), slice(30, 40)):
        parts.add(depth[rows], truth[rows], classes[rows])
    expected, result = whole.result(), parts.result()
    assert list(result) == list(THINGS)
    for name in THINGS:
        for distance in ("80", *STRETCHES):
            assert result[name][distance].pixels == expected[name][distance].pixels
            assert result[name][distance].median_m == expected[name][distance].median_m
            assert result[name][distance].mae_m == pytest.approx(expected[name][distance].mae_m)


def test_without_things_there_is_nothing():
    sums = ThingAccumulator(80.0)
    sums.add(np.ones((2, 2), np.float32), np.ones((2, 2), np.float32), np.full((2, 2), 255, np.uint8))
    assert json.dumps(things_json(sums.result())) == "{}"
