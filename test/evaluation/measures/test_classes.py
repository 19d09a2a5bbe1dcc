from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.evaluation.measures.classes import ClassMeans
from radcam_depth_ros.evaluation.measures.metrics import DepthRange, measure, measure_labels


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 80))
def test_labels_are_measured_as_if_each_were_alone(seed, count):
    generator = np.random.default_rng(seed)
    prediction, truth = generator.uniform(0.5, 100, (2, count)).astype(np.float32)
    labels = generator.integers(0, 4, count)
    rows = measure_labels(prediction, truth, labels, 5, 80.0)
    assert np.isnan(rows[4]).all()
    for label in range(4):
        shows = labels == label
        expected = measure(prediction[shows], truth[shows], 80.0) if shows.any() else np.full(8, np.nan)
        np.testing.assert_allclose(rows[label], expected, rtol=1e-5, atol=1e-6)


def test_what_has_no_ground_truth_is_left_out():
    means = ClassMeans(DepthRange.within(80.0))
    classes = np.array([[0, 2, 10, 13, 255]], np.uint8)
    truth = np.array([[10.0, 20.0, np.inf, 90.0, 5.0]], np.float32)
    means.add(truth + 1, truth, classes)
    means.add(truth + 3, truth, np.array([[0, 255, 255, 255, 255]], np.uint8))
    by_class, by_group = means.result()
    assert {entry.name: entry.mae for entry in by_class} == pytest.approx({"road": 2.0, "building": 1.0})
    assert {entry.name: entry.mae for entry in by_group} == pytest.approx(
        {"trees and buildings": 1.0, "road, people and vehicles": 2.0}
    )
    assert {entry.name: entry.frames for entry in by_class} == {"road": 2, "building": 1}
