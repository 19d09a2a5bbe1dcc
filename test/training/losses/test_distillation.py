"""One network learns from another."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from small_training import RECIPE
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.networks import DistillationFeatures
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.distillation import (
    distillation_loss,
    feature_loss,
    features_of,
    inter_depth_loss,
    similarity_loss,
)

OFF = replace(RECIPE.distillation, image=0.0, radar=0.0, decoder=0.0, inter_depth=0.0)


def make_features(seed: int, decoder_channels: int = 4) -> DistillationFeatures:
    """Of a batch of two images of 32 x 64 pixels."""
    generator = torch.Generator().manual_seed(seed)

    def maps(channels: int, strides: tuple[int, ...]) -> list[Tensor]:
        return [
            (torch.rand(2, channels, 32 // stride, 64 // stride, generator=generator) + 0.1).requires_grad_()
            for stride in strides
        ]

    depths = [(50 * depth.detach()).requires_grad_() for depth in maps(1, (1, 1, 1))]
    encoder = (2, 4, 8, 16, 32)
    return DistillationFeatures(maps(3, encoder), maps(5, encoder), maps(decoder_channels, (16, 8, 4, 2, 1)), depths)


def test_feature_loss_halves_from_scale_to_scale() -> None:
    student = [torch.full((2, 3, 4, 4), 2.0), torch.full((2, 3, 2, 2), 1.0)]
    teacher = [torch.full((2, 3, 4, 4), 5.0), torch.full((2, 3, 2, 2), -1.0)]
    assert float(feature_loss(student, teacher, "image")) == pytest.approx(3.0 / 2 + 2.0 / 4)


def test_similarity_by_hand() -> None:
    """Two places: alike for the student (cosine 1), at right angles for the teacher (cosine 0)."""
    student = [torch.tensor([[3.0, 3.0], [4.0, 4.0]]).reshape(1, 2, 1, 2)]
    teacher = [torch.tensor([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]]).reshape(1, 3, 1, 2)]
    # Pooled to 2 x 2 places: both rows of places see the same row of pixels.
    assert float(similarity_loss(student, teacher, 2)) == pytest.approx(0.5 / 2)
    assert float(similarity_loss(student, [7 * student[0]], 2)) == pytest.approx(0.0, abs=1e-6)


def test_inter_depths_are_weighed_by_their_uncertainty() -> None:
    student, teacher = [torch.full((1, 1, 2, 2), 15.0)] * 3, [torch.full((1, 1, 2, 2), 10.0)] * 3
    expected = (1 - math.exp(-1.0)) * 5.0 * (1 / 2 + 1 / 4 + 1 / 8)
    assert float(inter_depth_loss(student, teacher, 0.2)) == pytest.approx(expected, rel=1e-5)


def test_the_student_learns_and_the_teacher_does_not() -> None:
    student, teacher = make_features(0), make_features(1, decoder_channels=7)
    total, parts = distillation_loss(student, teacher, RECIPE.distillation)
    assert float(total.detach()) == pytest.approx(sum(float(part) for part in parts.values()), rel=1e-5)
    total.backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    for value in (value for maps in student for value in maps):
        assert value.grad is not None
        assert torch.isfinite(value.grad).all()
        assert value.grad.any()
    assert all(value.grad is None for maps in teacher for value in maps)


def test_who_knows_all_has_no_loss() -> None:
    student = make_features(0)
    assert float(distillation_loss(student, student, RECIPE.distillation)[0].detach()) == pytest.approx(0.0, abs=1e-6)


def test_samples_neither_touch_each_other_nor_have_an_order() -> None:
    student, teacher = make_features(0), make_features(1)

    def loss(*index: int) -> float:
        pick = [DistillationFeatures(*([x[list(index)] for x in maps] for maps in side)) for side in (student, teacher)]
        return float(distillation_loss(pick[0], pick[1], RECIPE.distillation)[0].detach())

    assert loss(0, 1) == pytest.approx((loss(0) + loss(1)) / 2, rel=1e-4)
    assert loss(0, 1) == pytest.approx(loss(1, 0), rel=1e-4)


def test_a_weight_of_zero_switches_a_term_off_and_then_it_need_not_fit() -> None:
    student, teacher = make_features(0), make_features(1)
    assert float(distillation_loss(student, teacher, OFF)[0]) == 0.0
    wrong = teacher._replace(image=teacher.radar)
    with pytest.raises(TrainingError, match=r"expected image of shapes \[\(2, 5, 16, 32\).*got \[\(2, 3, 16, 32\)"):
        distillation_loss(student, wrong, RECIPE.distillation)
    total, parts = distillation_loss(student, wrong, replace(OFF, radar=2.0))
    assert list(parts) == ["distilled_radar"]
    assert float(total.detach()) == pytest.approx(2 * float(parts["distilled_radar"]))


def test_cafnet_teaches_lircdepth() -> None:
    inputs = (torch.rand(1, 3, 64, 64), torch.ones(1, 2, 6), torch.ones(1, 2, dtype=torch.bool), torch.zeros(1, 4))
    with torch.no_grad():
        found = [
            features_of(networks.create(name).eval().train_outputs(*inputs), name) for name in ("lircdepth", "cafnet")
        ]
        total, parts = distillation_loss(found[0], found[1], RECIPE.distillation)
    assert len(parts) == 4
    assert torch.isfinite(total)
    for features in found:
        assert [len(maps) for maps in features] == [5, 5, 5, 3]
        assert [x.shape[2] for x in features.decoder] == [4, 8, 16, 32, 64]
        assert all(x.shape == (1, 1, 64, 64) for x in features.inter_depth_m)


def test_a_network_that_tells_nothing_is_refused() -> None:
    with pytest.raises(TrainingError, match="baff can neither teach nor learn by distillation"):
        features_of((1, 2), "baff")


@pytest.mark.parametrize("wrong", [{"image": -1.0}, {"beta": 0.0}, {"cells": 0}])
def test_wrong_values_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="must"):
        replace(RECIPE.distillation, **wrong)  # type: ignore[arg-type]  # one of them is a whole number
