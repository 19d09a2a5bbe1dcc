"""The published protocols against small implementations of their own, pixel by pixel on a 6 x 8 image."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from radcam_depth_ros.drive.published import published_depth
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS, RANGES_M, PublishedMeans
from radcam_depth_ros.frame import CameraModel

NOTHING = float("nan")
# Rows of truth with a pixel on every bound: 0, 0.001, 50, 70 and 80 m, a step of 1/256 m to either side.
STEP = 1 / 256
TRUTH = np.array(
    [
        [10.0, NOTHING, 20.0, NOTHING, 30.0, NOTHING, 40.0, 60.0],  # the rows up to here are left out by two protocols
        [NOTHING] * 8,
        [5.0, 75.0, NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, 79.0],
        [50.0, NOTHING, NOTHING, NOTHING, 70.0, NOTHING, NOTHING, 80.0],
        [50.0, 50.0 - STEP, 50.0 + STEP, 70.0, 70.0 - STEP, 70.0 + STEP, NOTHING, 0.0],
        [80.0, 80.0 - STEP, 80.0 + STEP, 0.001, STEP, 12.5, 99.0, NOTHING],
    ],
    np.float32,
)
PREDICTION = np.array(
    [
        [12.0, 3.0, 19.0, 3.0, 33.0, 3.0, 95.0, 61.0],
        [1.0] * 8,
        [4.0, 90.0, 1.0, 1.0, 1.0, 1.0, 1.0, 100.0],
        [55.0, 1.0, 1.0, 1.0, 75.0, 1.0, 1.0, 85.0],
        [49.0, 55.0, 52.0, 71.0, 66.0, 90.0, 1.0, 2.0],
        [100.0, 60.0, 70.0, 1.5, 0.0, 150.0, 90.0, 1.0],
    ],
    np.float32,
)


def singh2023(truth: float, prediction: float, row: int, limit: float) -> float | None:
    return prediction - truth if 0 < truth < limit else None


def cafnet(truth: float, prediction: float, row: int, limit: float) -> float | None:
    if row < 4 or not float(np.float32(0.001)) < truth < limit:  # depth images are float32
        return None
    return min(max(prediction, 0.001), limit) - truth


def justdepth(truth: float, prediction: float, row: int, limit: float) -> float | None:
    if row < 4 or not 0 < truth <= limit:
        return None
    return min(max(prediction, 0.0), limit) - truth


SMALL = (singh2023, cafnet, justdepth)


def by_hand(
    rule: Callable[[float, float, int, float], float | None], truth: np.ndarray, prediction: np.ndarray
) -> list:
    rows = []
    for limit in RANGES_M:
        errors = [
            error
            for row in range(truth.shape[0])
            for column in range(truth.shape[1])
            if (error := rule(float(truth[row, column]), float(prediction[row, column]), row, limit)) is not None
        ]
        count = len(errors)
        rows.append(
            [sum(map(abs, errors)) / count, math.sqrt(sum(error**2 for error in errors) / count)]
            if count
            else [NOTHING, NOTHING]
        )
    return rows


@pytest.mark.parametrize("rule", SMALL, ids=lambda rule: rule.__name__)
def test_each_protocol_is_that_of_its_paper(rule: Callable[..., float | None]) -> None:
    found = PROTOCOLS[rule.__name__].measure(PREDICTION, TRUTH)
    assert np.allclose(found, by_hand(rule, TRUTH, PREDICTION), rtol=1e-6)
    rng = np.random.default_rng(1)
    truth = rng.choice([NOTHING, 1.0, 49.0, 50.0, 69.0, 70.0, 80.0, 81.0], (6, 8)).astype(np.float32)
    prediction = rng.uniform(0, 120, (6, 8)).astype(np.float32)
    found = PROTOCOLS[rule.__name__].measure(prediction, truth)
    assert np.allclose(found, by_hand(rule, truth, prediction), rtol=1e-6, equal_nan=True)


def test_the_pixels_that_count_are_those_counted_by_hand() -> None:
    """With a prediction of truth + 1 every error is 1 or what clipping leaves: the sums were counted on paper."""
    over = np.where(np.isnan(TRUTH), 0, TRUTH).astype(np.float32) + 1
    # singh2023, 50 m: 10 20 30 40 5, 50 - s, 0.001, s and 12.5 count: errors of 1 each.
    assert PROTOCOLS["singh2023"].measure(over, TRUTH)[0] == pytest.approx([1.0, 1.0], abs=1e-5)
    # cafnet, 50 m: 50 - s (clipped to 50: error s), s and 12.5 (1 each); 0.001 is not beyond 0.001, 50 is not below 50.
    assert PROTOCOLS["cafnet"].measure(over, TRUTH)[0, 0] == pytest.approx((STEP + 2) / 3, abs=1e-6)
    # justdepth, 50 m: 50 counts as well (clipped to 50: error 0), and so does 0.001 (error 1).
    assert PROTOCOLS["justdepth"].measure(over, TRUTH)[0, 0] == pytest.approx((0 + STEP + 1 + 1 + 1) / 5, abs=1e-6)
    # justdepth, 80 m: 50 50-s 50+s 70 70-s 70+s 0.001 s 12.5 have 1 each, 80 has 0, 80 - s has s.
    assert PROTOCOLS["justdepth"].measure(over, TRUTH)[2, 0] == pytest.approx((9 + 0 + STEP) / 11, abs=1e-6)


def test_frames_are_averaged_and_not_pixels() -> None:
    protocol, means = PROTOCOLS["singh2023"], PublishedMeans()
    few, many = np.full((6, 8), np.nan, np.float32), np.full((6, 8), 10.0, np.float32)
    few[5, 5] = 60.0
    means.add(protocol.measure(few + 4, few))
    means.add(protocol.measure(many + 1, many))
    means.add(protocol.measure(many, np.full((6, 8), np.nan, np.float32)))
    result = means.result()
    assert result.frames == (1, 2, 2)
    assert result.mae_m == pytest.approx((1.0, 2.5, 2.5))
    assert result.rmse_m == pytest.approx((1.0, 2.5, 2.5))
    assert PublishedMeans().result().as_json()["80"] == {"mae": None, "rmse": None, "frames": 0}


def test_sizes_must_agree() -> None:
    with pytest.raises(EvaluationError, match="one size"):
        PROTOCOLS["cafnet"].measure(PREDICTION[:5], TRUTH)


CAMERA = CameraModel(8, 6, 1.0, 1.0, 0.0, 0.0)


def draw(*points: tuple[float, float, float]) -> np.ndarray:
    """The depth image of points given as column, row and depth."""
    u, v, z = np.array(points, np.float64).T
    return published_depth(np.stack([u * z, v * z, z], axis=1), CAMERA)


@pytest.mark.parametrize(
    ("point", "pixel"),
    [
        ((4.0, 3.0, 1.0), None),  # not beyond 1 m
        ((4.0, 3.0, 1.0 + STEP), (3, 4)),
        ((1.0, 3.0, 2.0), None),  # not more than 1 px inside
        ((1.25, 3.0, 2.0), (3, 1)),
        ((7.0, 3.0, 2.0), None),
        ((6.75, 3.0, 2.0), (3, 7)),
        ((4.0, 1.0, 2.0), None),
        ((4.0, 1.25, 2.0), (1, 4)),
        ((4.0, 5.0, 2.0), None),
        ((4.0, 4.75, 2.0), (5, 4)),
        ((2.5, 3.5, 2.0), (4, 2)),  # halves are rounded to even numbers
        ((3.5, 2.5, 2.0), (2, 4)),
        ((4.0, 3.0, -2.0), None),
    ],
)
def test_points_on_the_bounds_of_the_image(point: tuple[float, float, float], pixel: tuple[int, int] | None) -> None:
    image = draw(point)
    found = [tuple(place) for place in np.argwhere(np.isfinite(image)).tolist()]
    assert found == ([] if pixel is None else [pixel])


def test_the_last_point_of_a_pixel_stays_and_depth_is_in_steps() -> None:
    image = draw((4.0, 3.0, 10.0), (4.25, 3.0, 20.999), (5.0, 3.0, 30.0), (5.0, 3.0, 8.0 + 1.5 * STEP))
    assert image[3, 4] == int(20.999 * 256) / 256
    assert image[3, 5] == 8.0 + STEP
