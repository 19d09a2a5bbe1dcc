"""The confidence's scale and offset."""

from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.training.validation import LogitCounts, platt_scaling


def counted(scale: float, offset: float, seed: int = 0, pixels: int = 200_000) -> LogitCounts:
    """Counts of confidences that say `sigmoid(logit)` where the truth is `sigmoid(scale * logit + offset)`."""
    rng = np.random.default_rng(seed)
    logit = rng.normal(0.5, 1.5, pixels)
    right = rng.random(pixels) < 1 / (1 + np.exp(-(scale * logit + offset)))
    return LogitCounts.of((1 / (1 + np.exp(-logit))).astype(np.float32), right)


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (0.5, -1.0), (1.7, 0.8)])
def test_it_finds_what_confidences_should_have_been(scale: float, offset: float) -> None:
    assert platt_scaling([counted(scale, offset)], (1.0, 0.0)) == pytest.approx((scale, offset), abs=0.04)


def test_it_goes_on_from_a_confidence_that_was_scaled_already() -> None:
    scale, offset = platt_scaling([counted(0.5, -1.0)], (2.0, 0.4))
    assert scale == pytest.approx(0.5 * 2.0, abs=0.08)
    assert offset == pytest.approx(0.5 * 0.4 - 1.0, abs=0.06)


def test_kinds_of_frames_count_alike_however_many_pixels_they_have() -> None:
    many, few = counted(1.0, 1.0), counted(1.0, -1.0, 1, 20_000)
    _, both = platt_scaling([many, few], (1.0, 0.0))
    assert both == pytest.approx(0.0, abs=0.05)
    _, summed = platt_scaling([many + few], (1.0, 0.0))
    assert summed > 0.6


@pytest.mark.parametrize("right", [[], [True] * 5, [False] * 5])
def test_without_both_right_and_wrong_pixels_it_stays(right: list[bool]) -> None:
    counts = LogitCounts.of(np.full(len(right), 0.7, np.float32), np.array(right, np.bool_))
    assert platt_scaling([counts], (1.3, 0.2)) == (1.3, 0.2)
