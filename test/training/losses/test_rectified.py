"""Depth losses with two ground truths, by hand."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.losses.rectified import depth_loss, rectified_depth_loss, sky_loss, uncertainty
from radcam_depth_ros.training.losses.smoothness import smoothness_loss

NAN, INF = float("nan"), float("inf")
BETA = 0.2
DEPTHS = st.floats(1.0, 100.0)


class Pair(Ranks):
    """As if another process had a part that is just as large."""

    def add(self, values: Tensor) -> Tensor:
        return 2 * values


def image_of(values: Any) -> Tensor:
    """A batch of one image of one row."""
    return torch.tensor(values, dtype=torch.float32).reshape(1, 1, 1, -1)


def u(predicted: float, truth: float) -> float:
    return 1 - math.exp(-abs(predicted - truth) / (BETA * (predicted + truth)))


def test_uncertainty_by_hand() -> None:
    assert float(uncertainty(torch.tensor(15.0), torch.tensor(10.0), BETA)) == pytest.approx(1 - math.exp(-1.0))
    assert float(uncertainty(torch.tensor(7.0), torch.tensor(7.0), BETA)) == 0.0
    assert float(uncertainty(torch.tensor(7.0), torch.tensor(0.0), BETA)) == pytest.approx(1 - math.exp(-5.0))


@settings(deadline=None)
@given(predicted=DEPTHS, truth=DEPTHS, farther=st.floats(1.0, 2.0))
def test_uncertainty_is_symmetric_and_grows_with_the_error(predicted: float, truth: float, farther: float) -> None:
    p, t = torch.tensor(predicted, dtype=torch.float64), torch.tensor(truth, dtype=torch.float64)
    value = float(uncertainty(p, t, BETA))
    assert 0 <= value < 1
    assert value == pytest.approx(float(uncertainty(t, p, BETA)))
    worse = max(p, t) * farther, min(p, t)
    assert float(uncertainty(*worse, BETA)) >= value - 1e-12


def test_two_truths_are_weighed_by_a_softmax() -> None:
    dense, accumulated, single = 12.0, 10.0, 15.0
    e_d, e_s = math.exp(u(dense, accumulated)), math.exp(u(dense, single))
    expected = (e_d * 2.0 + e_s * 3.0) / (e_d + e_s)
    loss = rectified_depth_loss(image_of([dense]), image_of([accumulated]), image_of([single]), 100.0, BETA)
    assert float(loss) == pytest.approx(expected, rel=1e-5)


def test_one_truth_counts_as_both() -> None:
    loss = rectified_depth_loss(image_of([12.0, 20.0]), image_of([10.0, NAN]), None, 100.0, BETA)
    assert float(loss) == pytest.approx(2.0)


def test_what_the_single_scan_does_not_know_weighs_less() -> None:
    """There it counts as 0 m; each truth has a mean over its own pixels."""
    dense, accumulated, single = image_of([12.0, 12.0]), image_of([10.0, 10.0]), image_of([NAN, 10.0])
    e_d, e_0 = math.exp(u(12, 10)), math.exp(1 - math.exp(-1 / BETA))
    expected = (2.0 * e_d / (e_d + e_0) + 1.0) / 2 + 1.0
    loss = rectified_depth_loss(dense, accumulated, single, 100.0, BETA)
    assert float(loss) == pytest.approx(expected, rel=1e-5)
    assert e_d / (e_d + e_0) < 0.5


def test_gradients_are_finite_and_those_of_a_weighted_l1() -> None:
    dense = image_of([12.0, 30.0, 50.0, 60.0]).requires_grad_()
    truth = image_of([10.0, NAN, INF, 60.0])
    loss = rectified_depth_loss(dense, truth, image_of([NAN, NAN, INF, 150.0]), 100.0, BETA)
    loss.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    e_d, e_0 = math.exp(u(12, 10)), math.exp(1 - math.exp(-1 / BETA))
    assert dense.grad is not None
    assert dense.grad.flatten().tolist() == pytest.approx([0.5 * e_d / (e_d + e_0), 0.0, 0.0, 0.0], rel=1e-5)


def make_batch(seed: int, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Dense depth and two truths, which know different pixels."""
    generator = torch.Generator().manual_seed(seed)
    dense, accumulated, single = 1 + 90 * torch.rand(3, count, 1, 6, 8, generator=generator)
    accumulated[torch.rand(accumulated.shape, generator=generator) < 0.3] = NAN
    single[torch.rand(single.shape, generator=generator) < 0.8] = NAN
    return dense, accumulated, single


def test_samples_neither_touch_each_other_nor_have_an_order() -> None:
    dense, accumulated, single = make_batch(0, 3)
    loss = rectified_depth_loss(dense, accumulated, single, 100.0, BETA)
    alone = [
        float(rectified_depth_loss(dense[i : i + 1], accumulated[i : i + 1], single[i : i + 1], 100.0, BETA))
        for i in range(3)
    ]
    assert float(loss) == pytest.approx(sum(alone) / 3, rel=1e-5)
    turned = rectified_depth_loss(dense.flip(0), accumulated.flip(0), single.flip(0), 100.0, BETA)
    assert float(turned) == pytest.approx(float(loss), rel=1e-5)


def test_processes_sum_up_to_the_loss_of_the_joint_batch() -> None:
    dense, accumulated, single = make_batch(1, 4)
    image = torch.rand(4, 3, 6, 8)
    whole = rectified_depth_loss(dense, accumulated, single, 100.0, BETA) + smoothness_loss(dense, image)
    parts = [
        rectified_depth_loss(dense[part], accumulated[part], single[part], 100.0, BETA, Pair())
        + smoothness_loss(dense[part], image[part], Pair())
        for part in (slice(2), slice(2, 4))
    ]
    assert float(sum(parts)) == pytest.approx(float(whole), rel=1e-5)


def test_depth_loss_is_an_l1_in_range_and_sky_goes_to_the_farthest() -> None:
    dense, truth = image_of([12.0, 30.0, 90.0, 60.0]), image_of([10.0, NAN, INF, 150.0])
    assert float(depth_loss(dense, truth, 100.0)) == pytest.approx(2.0)
    assert float(sky_loss(dense, truth, 100.0)) == pytest.approx((10.0 + 40.0) / 2)


def test_smoothness_counts_less_at_an_edge_of_the_image() -> None:
    dense = torch.tensor([[10.0, 12.0, 15.0], [10.0, 12.0, 15.0]]).reshape(1, 1, 2, 3)
    image = torch.zeros(1, 3, 2, 3)
    image[..., 2] = 1.0
    assert float(smoothness_loss(dense, image)) == pytest.approx((2.0 + 3.0 * math.exp(-1.0)) / 2)
    assert float(smoothness_loss(torch.full_like(dense, 7.0), image)) == 0.0
