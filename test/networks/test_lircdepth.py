"""Parts of `lircdepth` of its own."""

from __future__ import annotations

import math

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from radcam_depth_ros import networks
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.cafnet import CHANNELS
from radcam_depth_ros.networks.layers.planar_guidance import PlanarDecoder
from radcam_depth_ros.networks.lircdepth import IMAGE_CHANNELS, RADAR_CHANNELS, Lircdepth


def test_parameters_and_operations_are_those_of_the_paper() -> None:
    """2.90 + 2.92 + 6.82 M parameters; its 121 G are multiply-adds, each counted once, and torch counts two."""
    with torch.device("meta"):
        network = networks.create("lircdepth", Lircdepth.paper).eval()
        image, radar, valid = torch.rand(1, 3, 896, 1600), torch.rand(1, 60, 6), torch.ones(1, 60, dtype=torch.bool)
        ground = torch.rand(1, 4)
    count = {name: sum(value.numel() for value in part.parameters()) for name, part in network.named_children()}
    assert count["image_encoder"] + count["image_affinity"] == pytest.approx(2.90e6, rel=0.005)
    assert count["radar_encoder"] + count["radar_affinity"] == pytest.approx(2.92e6, rel=0.005)
    assert count["decoder"] == pytest.approx(6.82e6, rel=0.005)
    assert sum(count.values()) == pytest.approx(12.65e6, rel=0.005)
    with FlopCounterMode(display=False) as counter, torch.inference_mode():
        network(image, radar, valid, ground)
    assert counter.get_total_flops() / 2 == pytest.approx(121e9, rel=0.03)


def test_its_maps_are_as_wide_as_the_teachers() -> None:
    assert IMAGE_CHANNELS == CHANNELS
    assert RADAR_CHANNELS == PlanarDecoder.RADAR_CHANNELS


def test_confidence_learns_alone() -> None:
    torch.manual_seed(0)
    network = networks.create("lircdepth").train()
    radar, valid = torch.ones(2, 3, 6), torch.ones(2, 3, dtype=torch.bool)
    outputs = network.train_outputs(torch.rand(2, 3, 32, 64), radar, valid, torch.full((2, 4), math.nan))
    outputs.confidence_logit.sum().backward()
    learns = {name.split(".")[0] for name, value in network.named_parameters() if value.grad is not None}
    assert learns == {"confidence"}


def test_semi_dense_depths_are_those_of_returns_that_agree_with_the_dense_depth() -> None:
    torch.manual_seed(0)
    network = networks.create("lircdepth", {"threshold": 0.001, "tolerance": 0.2, "caution": 0.0}).eval()
    # An untrained network says about 50 m everywhere.
    radar, valid = torch.zeros(1, 3, 6), torch.tensor([[True, True, False]])
    radar[0, :, :3] = torch.tensor([[10.0, 16.0, 48.0], [50.0, 16.0, 20.0], [30.0, 16.0, 51.0]])
    with torch.inference_mode():
        depths = network(torch.rand(1, 3, 32, 64), radar, valid, torch.full((1, 4), math.nan))
    found = ~torch.isnan(depths.semi_dense)
    assert found.any()
    assert depths.semi_dense[found].unique().tolist() == [48.0]
    assert ((depths.dense - 48.0).abs() < 0.2 * depths.dense)[found].all()
    assert not found[..., 10 + 21 // 2 + 1 :].any()


@pytest.mark.parametrize(
    ("architecture", "message"),
    [
        ({"threshold": 1.0}, "threshold must lie between 0 and 1, got 1.0"),
        ({"tolerance": 0.0}, "tolerance must lie between 0 and 1, got 0.0"),
        ({"min_depth_m": 10, "max_depth_m": 5}, "depth range"),
        ({"patch_px": [11, 4]}, "two odd numbers"),
        ({"focal_length_px": -1.0}, "focal_length_px must be positive"),
    ],
)
def test_architectures_that_cannot_be(architecture: dict[str, object], message: str) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        networks.create("lircdepth", architecture)
