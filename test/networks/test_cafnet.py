"""Parts of `cafnet` of its own."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.utils.flop_counter import FlopCounterMode

from radcam_depth_ros import networks
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.cafnet import Cafnet, ConfidenceGate, SparseStem
from radcam_depth_ros.networks.layers.patches import around, covered
from radcam_depth_ros.networks.layers.planar_guidance import PlanarGuidance

RESNET_CLASSIFIER = 512 * 1000 + 1000


def test_parameters_and_operations_are_those_of_the_paper() -> None:
    """The paper's 62.25 M count the classifiers of all three ResNets, which nothing uses and which are not here.

    Its 685 G are multiply-adds, each counted once; torch counts two.
    """
    with torch.device("meta"):
        network = networks.create("cafnet", Cafnet.paper).eval()
        image, radar, valid = torch.rand(1, 3, 896, 1600), torch.rand(1, 60, 6), torch.ones(1, 60, dtype=torch.bool)
        ground = torch.rand(1, 4)
    parameters = sum(value.numel() for value in network.parameters())
    assert parameters + 3 * RESNET_CLASSIFIER == pytest.approx(62.25e6, rel=0.005)
    with FlopCounterMode(display=False) as counter, torch.inference_mode():
        network(image, radar, valid, ground)
    assert counter.get_total_flops() / 2 == pytest.approx(685e9, rel=0.02)


def test_a_plane_parallel_to_the_image_has_one_depth() -> None:
    raw = torch.tensor([-50.0, 0.3, 0.0]).reshape(1, 3, 1, 1).expand(2, 3, 2, 3)
    depth, thinned = PlanarGuidance(8, 80.0)(raw)
    assert depth.shape == (2, 1, 16, 24)
    assert thinned.shape == (2, 1, 4, 6)
    torch.testing.assert_close(depth, torch.full_like(depth, 40.0))
    torch.testing.assert_close(thinned, torch.full_like(thinned, 40.0))


def test_an_inclined_plane_by_hand() -> None:
    """Polar angle 30 degrees, to the right (azimuth 0), at 20 m: 20 / (sin 30 u + cos 30)."""
    polar = math.log(0.5 / (1 - 0.5))
    raw = torch.tensor([polar, -50.0, math.log(0.2 / 0.8)]).reshape(1, 3, 1, 1)
    depth, thinned = PlanarGuidance(4, 100.0)(raw)
    expected = [20 / (0.5 * u + math.sqrt(0.75)) for u in (-0.375, -0.125, 0.125, 0.375)]
    for row in depth[0, 0]:
        assert row.tolist() == pytest.approx(expected, rel=1e-5)
    assert thinned[0, 0, 0].tolist() == pytest.approx([expected[1], expected[3]], rel=1e-5)


@settings(max_examples=20, deadline=None)
@given(values=st.lists(st.floats(-30, 30), min_size=3, max_size=3))
def test_planes_stay_within_the_depth_range_and_pass_finite_gradients(values: list[float]) -> None:
    raw = torch.tensor(values).reshape(1, 3, 1, 1).requires_grad_()
    depth, _ = PlanarGuidance(8, 100.0)(raw)
    assert ((depth >= 0) & (depth <= 100)).all()
    depth.sum().backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert raw.grad is not None
    assert torch.isfinite(raw.grad).all()


def test_a_gate_lets_nothing_through_where_radar_is_not_sure() -> None:
    torch.manual_seed(0)
    gate = ConfidenceGate(4, 6)
    confidence = torch.tensor([[0.0, 1.0]]).reshape(1, 1, 1, 2)
    gated = gate(torch.rand(1, 4, 1, 2) + 1.0, confidence)
    assert gated.shape == (1, 6, 1, 2)
    assert not gated[..., 0].any()
    assert gated[..., 1].any()


def test_stage_one_sees_nothing_far_from_any_return() -> None:
    """Its sparse convolutions reach 3 + 2 + 1 + 1 pixels; beyond, there are their biases alone."""
    stem = SparseStem()
    planes = torch.zeros(1, 4, 20, 24)
    without = stem(planes)
    planes[0, :, 9, 10] = torch.tensor([0.5, 0.2, -0.1, 1.0])
    changed = (stem(planes) != without).any(dim=1)[0]
    assert changed[9, 10]
    assert not changed[:2].any()
    assert not changed[17:].any()
    assert not changed[:, :3].any()
    assert not changed[:, 18:].any()


def test_semi_dense_depth_is_the_coarse_one_around_returns() -> None:
    torch.manual_seed(0)
    network = networks.create("cafnet", {"threshold": 0.001, "patch_px": [9, 5]}).eval()
    radar, valid = torch.zeros(1, 2, 6), torch.ones(1, 2, dtype=torch.bool)
    radar[0, :, :3] = torch.tensor([[20.0, 30.0, 12.0], [50.0, 8.0, 40.0]])
    with torch.inference_mode():
        outputs = network.train_outputs(torch.rand(1, 3, 32, 64), radar, valid, torch.full((1, 4), math.nan))
    reached = covered(around(radar, valid, 32, 64, (9, 5)), 32, 64)
    semi_dense = outputs.depths.semi_dense
    assert torch.equal(~torch.isnan(semi_dense), reached)
    torch.testing.assert_close(semi_dense[reached], outputs.coarse_m[reached])
    torch.testing.assert_close(outputs.depths.confidence, torch.sigmoid(outputs.confidence_logit))


@pytest.mark.parametrize(
    ("architecture", "message"),
    [
        ({"threshold": 0.0}, "threshold must lie between 0 and 1, got 0.0"),
        ({"min_depth_m": 10, "max_depth_m": 5}, "depth range"),
        ({"patch_px": [10, 5]}, "two odd numbers"),
        ({"focal_length_px": 0.0}, "focal_length_px must be positive"),
    ],
)
def test_architectures_that_cannot_be(architecture: dict[str, object], message: str) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        networks.create("cafnet", architecture)
