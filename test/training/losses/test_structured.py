from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.structured import StructuredOutputs
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.registry import Criterion
from radcam_depth_ros.training.losses.smoothness import smoothness_loss
from radcam_depth_ros.training.losses.structured import (
    LossConfig,
    coarse_loss,
    depth_loss,
    segmentation_loss,
    total_loss,
)

LOSS: LossConfig = Criterion.of("structured", {}).config

NAN, INF = float("nan"), float("inf")
ROAD, BUILDING, SKY, CAR = (CLASS_NAMES.index(name) for name in ("road", "building", "sky", "car"))
CONFIG = replace(LOSS, sky_margin_px=0)


def row(values: list[float]) -> Tensor:
    """One row of pixels."""
    return torch.tensor([[[values]]])


def shown(values: list[int]) -> Tensor:
    return torch.tensor([[values]], dtype=torch.uint8)


def random_batch(count: int, height: int = 32, width: int = 64) -> tuple[StructuredOutputs, Batch]:
    """Outputs that learn, with unknown pixels, sky, and a sample that knows little."""
    generator = torch.Generator().manual_seed(0)
    truth = 1 + 120 * torch.rand(count, 1, height, width, generator=generator)
    truth[:, :, :4] = INF
    truth[:, :, 10:14, ::2] = NAN
    truth[-1, :, 8:] = NAN
    classes = torch.randint(0, 19, (count, height, width), generator=generator, dtype=torch.uint8)
    classes[:, 20:] = UNKNOWN_CLASS
    dense, coarse = (1 + 99 * torch.rand(truth.shape, generator=generator) for _ in range(2))
    outputs = StructuredOutputs(
        Depths(dense.requires_grad_(), dense, dense),
        torch.randn(truth.shape, generator=generator).requires_grad_(),
        coarse.requires_grad_(),
        torch.rand(truth.shape, generator=generator) > 0.7,
        torch.randn(count, 19, height, width, generator=generator).requires_grad_(),
    )
    image = torch.rand(count, 3, height, width, generator=generator)
    nothing = torch.zeros(count, 0)
    return outputs, Batch(
        image, nothing, nothing, nothing, truth, None, classes, torch.ones(len(truth), dtype=torch.bool)
    )


def take(outputs: StructuredOutputs, batch: Batch, index: list[int]) -> tuple[StructuredOutputs, Batch]:
    """Some of the samples, in this order; copies that learn."""

    def of(values: Tensor) -> Tensor:
        copy = values.detach()[index].clone()
        return copy.requires_grad_() if copy.is_floating_point() else copy

    assert outputs.class_logits is not None
    dense = of(outputs.depths.dense)
    taken = StructuredOutputs(
        Depths(dense, dense, dense),
        of(outputs.confidence_logit),
        of(outputs.coarse_m),
        outputs.reached[index],
        of(outputs.class_logits),
    )
    return taken, replace(
        batch,
        image=batch.image[index],
        depth_accumulated_m=batch.depth_accumulated_m[index],
        classes=batch.classes[index],
    )


def test_the_road_weighs_omega_and_all_else_the_rest() -> None:
    dense = row([11.0, 12.0, 14.0, 18.0, 50.0])
    truth = row([10.0, 10.0, 10.0, 10.0, NAN])
    loss = depth_loss(dense, truth, shown([ROAD, CAR, BUILDING, UNKNOWN_CLASS, ROAD]), 100.0, CONFIG)
    assert float(loss) == pytest.approx((1.4 * 1 + 1.4 * 2 + 0.6 * 4 + 1.0 * 8) / 4)


def test_sky_and_what_is_beyond_the_range_are_drawn_to_the_farthest_depth() -> None:
    config = replace(LOSS, sky=0.5)
    loss = depth_loss(row([90.0, 70.0]), row([INF, 140.0]), shown([SKY, BUILDING]), 100.0, config)
    assert float(loss) == pytest.approx(0.5 * 0.6 * (10 + 30) / 2)


def test_depth_is_smooth_where_the_image_is() -> None:
    dense = torch.tensor([[[[10.0, 12.0], [10.0, 15.0]]]])
    image = torch.zeros(1, 3, 2, 2)
    image[0, 0, :, 1] = 0.9  # an edge between the columns: 0.3, the channels' mean
    across = math.exp(-0.3) * (2 + 5) / 2
    along = (0 + 3) / 2
    assert float(smoothness_loss(dense, image)) == pytest.approx(across + along, rel=1e-6)


def test_coarse_depth_is_judged_where_a_return_reaches() -> None:
    reached = row([1.0, 1.0, 0.0, 1.0, 1.0]) > 0
    truth = row([10.0, NAN, 10.0, INF, 150.0])
    assert float(coarse_loss(row([13.0, 9.0, 9.0, 9.0, 9.0]), reached, truth, 100.0)) == pytest.approx(3.0)
    assert float(coarse_loss(row([13.0] * 5), torch.zeros_like(reached), truth, 100.0)) == 0.0


def test_classes_are_a_cross_entropy_where_they_are_known() -> None:
    logits = torch.zeros(1, 19, 1, 2)
    logits[0, CAR, 0, 0] = 2.0
    loss = segmentation_loss(logits, shown([CAR, UNKNOWN_CLASS]))
    assert float(loss) == pytest.approx(math.log(18 + math.exp(2.0)) - 2.0, rel=1e-6)
    assert float(segmentation_loss(logits, shown([UNKNOWN_CLASS, UNKNOWN_CLASS]))) == 0.0


def test_the_total_weighs_its_parts() -> None:
    outputs, batch = random_batch(2)
    total, parts = total_loss(outputs, batch, 100.0, CONFIG)
    depths = parts["depth"] + 0.001 * parts["smoothness"] + 0.3 * parts["coarse"]
    expected = 0.5 * depths + parts["segmentation"] + 0.1 * parts["confidence"]
    assert float(total.detach()) == pytest.approx(float(expected), rel=1e-6)
    assert not any(part.requires_grad for part in parts.values())
    _, parts = total_loss(outputs._replace(class_logits=None), batch, 100.0, CONFIG)
    assert set(parts) == {"depth", "smoothness", "coarse", "confidence"}


def test_gradients_are_finite_where_nothing_is_known() -> None:
    outputs, batch = random_batch(3)
    total, _ = total_loss(outputs, batch, 100.0, CONFIG)
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for learns in (outputs.depths.dense, outputs.confidence_logit, outputs.coarse_m, outputs.class_logits):
        assert learns is not None
        assert learns.grad is not None
        assert torch.isfinite(learns.grad).all()
        assert learns.grad.any()


def test_the_order_of_a_batch_does_not_matter() -> None:
    outputs, batch = random_batch(3)
    total, parts = total_loss(outputs, batch, 100.0, CONFIG)
    again, others = total_loss(*take(outputs, batch, [2, 0, 1]), 100.0, CONFIG)
    torch.testing.assert_close(total, again)
    torch.testing.assert_close(parts, others)


def test_samples_do_not_touch_each_other() -> None:
    """The gradient of a sample is what it is alone, but for the share that it has in the mean."""
    outputs, batch = random_batch(3)
    total, _ = total_loss(outputs, batch, 100.0, CONFIG)
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    alone, single = take(outputs, batch, [1])
    total_loss(alone, single, 100.0, CONFIG)[0].backward()  # type: ignore[no-untyped-call]  # as above
    pairs = ((outputs.depths.dense, alone.depths.dense), (outputs.confidence_logit, alone.confidence_logit))
    for together, apart in pairs:
        assert together.grad is not None
        assert apart.grad is not None
        torch.testing.assert_close(3 * together.grad[1:2], apart.grad)


@pytest.mark.parametrize("fusion", ["single", "add", "conf", "seg"])
def test_training_reaches_every_parameter_with_finite_gradients(fusion: str) -> None:
    torch.manual_seed(0)
    network = networks.create("structured", {"fusion": fusion, "backbone": "resnet18", "joined_channels": 32}).train()
    _, batch = random_batch(2, 32, 64)
    radar = torch.tensor([[40.0, 20.0, 30.0, 5.0, NAN, NAN], [10.0, 25.0, 8.0, NAN, 1.0, 0.0]]).expand(2, -1, -1)
    valid = torch.tensor([[True, True], [True, False]])
    outputs = network.train_outputs(batch.image, radar, valid, torch.full((2, 4), NAN))
    total, parts = total_loss(outputs, batch, 100.0, CONFIG)
    assert all(torch.isfinite(part) for part in parts.values())
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


@pytest.mark.parametrize(
    "wrong", [{"sky": -1.0}, {"depths": -0.5}, {"road": 2.5}, {"confidence_tolerance": 0.0}, {"sky_margin_px": -1}]
)
def test_wrong_weights_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="must"):
        replace(LOSS, **wrong)  # type: ignore[arg-type]  # keys are of several types
