"""What `lircdepth` is trained to."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from radcam_depth_ros.networks import Depths, DistillationFeatures
from radcam_depth_ros.networks.lircdepth import LircdepthOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.lircdepth import LossConfig, total_loss
from radcam_depth_ros.training.losses.registry import Criterion

LOSS: LossConfig = Criterion.of("lircdepth", {}).config

INF = float("inf")
OFF = replace(LOSS, depth=0.0, smoothness=0.0, sky=0.0, confidence=0.0, sky_margin_px=0)


def two_rows(*values: float) -> Tensor:
    """An image of two equal rows."""
    return torch.tensor(values).expand(1, 1, 2, -1).clone()


def make_batch(truth: Tensor, single: Tensor | None = None) -> Batch:
    count, _, height, width = truth.shape
    return Batch(
        image=torch.zeros(count, 3, height, width),
        radar=torch.ones(count, 1, 6),
        valid=torch.zeros(count, 1, dtype=torch.bool),
        ground=torch.zeros(count, 4),
        depth_accumulated_m=truth,
        depth_single_m=single,
        classes=torch.full((count, height, width), 255, dtype=torch.uint8),
        readable=torch.ones(count, dtype=torch.bool),
    )


def make_outputs(dense: Tensor, logit: Tensor) -> LircdepthOutputs:
    return LircdepthOutputs(Depths(dense, dense, torch.sigmoid(logit)), logit, DistillationFeatures([], [], [], []))


def test_inter_depths_and_logarithms_are_off_by_default_and_learn_from_the_truth() -> None:
    dense = two_rows(20.0, 10.0).requires_grad_()
    inter_m = [two_rows(14.0, 10.0).requires_grad_(), two_rows(10.0, 18.0).requires_grad_()]
    outputs = make_outputs(dense, two_rows(0.0, 0.0))._replace(features=DistillationFeatures([], [], [], inter_m))
    batch = make_batch(two_rows(10.0, INF))
    assert total_loss(outputs, batch, 100.0, OFF)[1] == {}
    total, parts = total_loss(outputs, batch, 100.0, replace(OFF, inter_depth=0.5, log_depth=3.0))
    assert float(parts["inter_depth"]) == pytest.approx(4.0 / 2 + 0.0 / 4)
    assert float(parts["log_depth"]) == pytest.approx(math.log(2.0))
    assert float(total.detach()) == pytest.approx(0.5 * 2.0 + 3.0 * math.log(2.0))
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert inter_m[0].grad is not None
    assert float(inter_m[0].grad.abs().sum()) > 0


def test_terms_by_hand_and_their_weights() -> None:
    dense = two_rows(12.0, 10.5, 90.0).requires_grad_()
    logit = two_rows(1.0, 2.0, 3.0).requires_grad_()
    batch = make_batch(two_rows(10.0, 10.0, INF))
    config = replace(OFF, depth=2.0, smoothness=0.5, sky=0.1, confidence=3.0)
    total, parts = total_loss(make_outputs(dense, logit), batch, 100.0, config)
    entropy = (math.log1p(math.exp(1.0)) + math.log1p(math.exp(-2.0))) / 2
    expected = {"depth": (2.0 + 0.5) / 2, "smoothness": (1.5 + 79.5) / 2, "sky": 10.0, "confidence": entropy}
    assert {name: float(value) for name, value in parts.items()} == pytest.approx(expected, rel=1e-5)
    assert float(total.detach()) == pytest.approx(
        sum(getattr(config, name) * value for name, value in expected.items())
    )
    assert not any(value.requires_grad for value in parts.values())
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for value in (dense.grad, logit.grad):
        assert value is not None
        assert torch.isfinite(value).all()


def test_a_weight_of_zero_switches_a_term_off() -> None:
    outputs = make_outputs(torch.full((2, 1, 2, 3), 12.0), torch.zeros(2, 1, 2, 3))
    batch = make_batch(torch.full((2, 1, 2, 3), 10.0), torch.full((2, 1, 2, 3), 11.0))
    total, parts = total_loss(outputs, batch, 100.0, OFF)
    assert float(total) == 0.0
    assert parts == {}
    for name in ("depth", "smoothness", "sky", "confidence"):
        total, parts = total_loss(outputs, batch, 100.0, replace(OFF, **{name: 2.0}))
        assert list(parts) == [name]
        assert float(total) == pytest.approx(2 * float(parts[name]))


@pytest.mark.parametrize("wrong", [{"sky": -1.0}, {"beta": 0.0}, {"confidence_tolerance": 0.0}])
def test_wrong_values_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="must"):
        replace(LOSS, **wrong)  # type: ignore[arg-type]  # one of them is a whole number
