"""What `cafnet` is trained to."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from radcam_depth_ros.networks import Depths, DistillationFeatures
from radcam_depth_ros.networks.cafnet import CafnetOutputs
from radcam_depth_ros.networks.layers.patches import around
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.cafnet import LossConfig, belonging, total_loss
from radcam_depth_ros.training.losses.registry import Criterion

LOSS: LossConfig = Criterion.of("cafnet", {}).config

NAN, INF = float("nan"), float("inf")
OFF = replace(LOSS, depth=0.0, coarse=0.0, confidence=0.0, smoothness=0.0, sky=0.0, sky_margin_px=0)


def two_rows(*values: float) -> Tensor:
    """An image of two equal rows."""
    return torch.tensor(values).expand(1, 1, 2, -1).clone()


def make_batch(truth: Tensor, *returns: tuple[float, float, float]) -> Batch:
    """Every sample of the batch has these returns (u, v, depth)."""
    count, _, height, width = truth.shape
    radar = torch.zeros(count, len(returns), 6)
    radar[:, :, :3] = torch.tensor(returns).reshape(1, -1, 3)
    return Batch(
        image=torch.zeros(count, 3, height, width),
        radar=radar,
        valid=torch.ones(count, len(returns), dtype=torch.bool),
        ground=torch.zeros(count, 4),
        depth_accumulated_m=truth,
        depth_single_m=None,
        classes=torch.full((count, height, width), 255, dtype=torch.uint8),
        readable=torch.ones(count, dtype=torch.bool),
    )


def make_outputs(batch: Batch, dense: Tensor, coarse: Tensor, logit: Tensor) -> CafnetOutputs:
    patches = around(batch.radar, batch.valid, dense.shape[2], dense.shape[3], (3, 3))
    depths = Depths(dense, dense, torch.sigmoid(logit))
    return CafnetOutputs(depths, coarse, logit, patches, DistillationFeatures([], [], [], []))


def test_pixels_belong_to_a_return_around_them_at_its_depth() -> None:
    truth = torch.full((2, 1, 3, 6), 10.2)
    truth[0, 0, 1, 1], truth[0, 0, 0, 0], truth[0, 0, 0, 1] = NAN, INF, 10.5
    truth[1] = 20.0
    batch = make_batch(truth, (1.0, 1.0, 10.0), (9.0, 1.0, 20.0))
    label = belonging(around(batch.radar, batch.valid, 3, 6, (3, 3)), batch.radar, truth, 0.4)
    expected = torch.zeros(3, 6, dtype=torch.bool)
    expected[:, :3] = True
    expected[1, 1] = expected[0, 0] = expected[0, 1] = False
    assert torch.equal(label[0, 0], expected)
    assert not label[1].any()


def test_without_returns_nothing_belongs_to_any() -> None:
    truth = torch.full((1, 1, 3, 6), 10.0)
    batch = make_batch(truth)
    assert not belonging(around(batch.radar, batch.valid, 3, 6, (3, 3)), batch.radar, truth, 0.4).any()


def test_terms_by_hand_and_their_weights() -> None:
    batch = make_batch(two_rows(10.0, 14.0, INF, NAN), (0.0, 0.0, 10.1))
    dense = two_rows(12.0, 13.0, 90.0, 50.0).requires_grad_()
    coarse = two_rows(11.0, 17.0, 40.0, 40.0).requires_grad_()
    logit = two_rows(1.0, 2.0, 3.0, 4.0).requires_grad_()
    config = replace(OFF, depth=2.0, coarse=0.5, confidence=3.0, smoothness=0.5, sky=0.1)
    total, parts = total_loss(make_outputs(batch, dense, coarse, logit), batch, 100.0, config)
    entropy = math.log1p(math.exp(-1.0)) + math.log1p(math.exp(2.0)) + math.log1p(math.exp(3.0))
    expected = {
        "depth": (2.0 + 1.0) / 2,
        "coarse": (1.0 + 3.0) / 2,
        "confidence": entropy / 3,
        "smoothness": (1.0 + 77.0 + 40.0) / 3,
        "sky": 10.0,
    }
    assert {name: float(value) for name, value in parts.items()} == pytest.approx(expected, rel=1e-5)
    assert float(total.detach()) == pytest.approx(
        sum(getattr(config, name) * value for name, value in expected.items())
    )
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for value in (dense.grad, coarse.grad, logit.grad):
        assert value is not None
        assert torch.isfinite(value).all()


def test_samples_neither_touch_each_other_nor_have_an_order() -> None:
    generator = torch.Generator().manual_seed(0)
    truth, dense, coarse = 5 + 20 * torch.rand(3, 3, 1, 4, 6, generator=generator)
    truth[torch.rand(truth.shape, generator=generator) < 0.4] = NAN
    logit = torch.randn(3, 1, 4, 6, generator=generator)

    def loss(index: Tensor) -> float:
        batch = make_batch(truth[index], (2.0, 2.0, 15.0))
        outputs = make_outputs(batch, dense[index], coarse[index], logit[index])
        return float(total_loss(outputs, batch, 100.0, LOSS)[0])

    alone = [loss(torch.tensor([index])) for index in range(3)]
    assert loss(torch.tensor([0, 1, 2])) == pytest.approx(sum(alone) / 3, rel=1e-5)
    assert loss(torch.tensor([2, 0, 1])) == pytest.approx(sum(alone) / 3, rel=1e-5)


def test_a_weight_of_zero_switches_a_term_off() -> None:
    batch = make_batch(torch.full((1, 1, 2, 3), 10.0), (1.0, 1.0, 10.0))
    outputs = make_outputs(batch, *torch.full((3, 1, 1, 2, 3), 12.0))
    assert total_loss(outputs, batch, 100.0, OFF)[1] == {}
    for name in ("depth", "coarse", "confidence", "smoothness", "sky"):
        assert list(total_loss(outputs, batch, 100.0, replace(OFF, **{name: 2.0}))[1]) == [name]


@pytest.mark.parametrize("wrong", [{"sky": -1.0}, {"beta": 0.0}, {"tolerance_m": 0.0}])
def test_wrong_values_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="must"):
        replace(LOSS, **wrong)  # type: ignore[arg-type]  # one of them is a whole number
