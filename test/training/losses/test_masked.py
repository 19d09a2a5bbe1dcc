"""Means over what is known."""

from __future__ import annotations

import pytest
import torch

from radcam_depth_ros.training.losses.masked import LEAST_SHARE, masked_mean, sample_mean


def test_every_sample_counts_alike_however_much_it_knows() -> None:
    values = torch.tensor([[1.0, 3.0], [5.0, float("nan")]])
    assert float(masked_mean(values, ~torch.isnan(values))) == pytest.approx((2.0 + 5.0) / 2)
    assert float(masked_mean(values, torch.tensor([[False, True], [False, False]]))) == pytest.approx(3.0)
    assert float(masked_mean(values, torch.zeros(2, 2))) == 0.0


def test_who_knows_next_to_nothing_counts_less() -> None:
    values, known = torch.full((1, 10_000), 8.0), torch.zeros(1, 10_000)
    known[0, :5] = 1.0
    assert float(masked_mean(values, known)) == pytest.approx(8.0 * 5 / (LEAST_SHARE * 10_000))


def test_means_over_samples() -> None:
    assert float(sample_mean(torch.tensor([[1.0, 3.0], [5.0, 7.0]]))) == pytest.approx(4.0)
