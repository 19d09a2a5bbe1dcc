"""Which returns' depths a network stands by."""

from __future__ import annotations

import math

import torch

from radcam_depth_ros.networks.layers.trusted import TrustedReturns

NAN = math.nan


def row(*values: float) -> torch.Tensor:
    return torch.tensor(values).reshape(1, 1, 1, -1)


def test_a_return_counts_where_depths_agree_and_the_confidence_is_enough_for_the_distance() -> None:
    # Agreed; no return; 3 m apart; a third apart near by; unsure; far away; far away and surer.
    found = row(10.0, NAN, 13.0, 4.0, 10.0, 70.0, 70.0)
    dense = row(10.0, 10.0, 10.0, 3.0, 10.0, 70.0, 70.0)
    confidence = row(0.8, 0.8, 0.8, 0.8, 0.5, 0.8, 0.9)
    kept = TrustedReturns(0.3)(found, dense, confidence)
    torch.testing.assert_close(kept, row(10.0, NAN, NAN, NAN, NAN, NAN, 70.0), equal_nan=True)


def test_neither_dense_depth_nor_confidence_learns_from_it() -> None:
    found, dense, confidence = (row(value).requires_grad_() for value in (10.0, 10.5, 0.9))
    TrustedReturns(0.1)(found, dense, confidence).sum().backward()
    assert float(found.grad) == 1.0  # type: ignore[arg-type]  # it is there
    assert dense.grad is None
    assert confidence.grad is None
