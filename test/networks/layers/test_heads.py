"""Calibration of the confidence's logit, and which returns are trusted."""

from __future__ import annotations

import math

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks import ArchitectureError, registry
from radcam_depth_ros.networks.layers.heads import CalibratedConfidence, TrustedReturns

NAN = math.nan


def test_scale_and_offset_are_of_the_logit() -> None:
    logit = torch.tensor([-2.0, 0.0, 3.0], dtype=torch.bfloat16)
    expected = torch.sigmoid(0.5 * logit.float() - 1.0)
    torch.testing.assert_close(CalibratedConfidence((0.5, -1.0))(logit), expected)
    torch.testing.assert_close(CalibratedConfidence((1.0, 0.0))(logit), torch.sigmoid(logit.float()))


@pytest.mark.parametrize("name", networks.names())
@pytest.mark.parametrize("wrong", [(0.0, 0.0), (-1.0, 0.0), (math.nan, 0.0), (1.0, math.inf)])
def test_a_calibration_that_cannot_be_is_refused(name: str, wrong: tuple[float, float]) -> None:
    with pytest.raises(ArchitectureError, match="calibration needs a scale above 0 and an offset"):
        registry.create_config(name, {"calibration": list(wrong)})


@pytest.mark.parametrize("name", networks.names())
def test_every_networks_calibration_can_be_changed_after_training(name: str) -> None:
    assert "calibration" in registry.find(name).adjustable


def test_depth_does_not_depend_on_the_calibration() -> None:
    given = (torch.rand(1, 3, 64, 96), torch.rand(1, 4, 6) * 40, torch.ones(1, 4, dtype=torch.bool), torch.zeros(1, 4))
    depths = []
    for calibration in ([1.0, 0.0], [0.3, -2.0]):
        torch.manual_seed(0)
        network = networks.create("baff", {"channels": [8, 8, 8, 8], "calibration": calibration}).eval()
        with torch.inference_mode():
            depths.append(network(*given))
    torch.testing.assert_close(depths[0].dense, depths[1].dense)
    torch.testing.assert_close(depths[0].semi_dense, depths[1].semi_dense, equal_nan=True)
    assert (depths[0].confidence > depths[1].confidence).all()


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
