"""The dense depth as a mix of the network's and geometry's, and the sky."""

from __future__ import annotations

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks import TrainOutputs
from radcam_depth_ros.networks.baff.geometry_mix import PLANES, GeometryMix
from radcam_depth_ros.networks.baff.network import Baff
from radcam_depth_ros.networks.baff.sky import WIDTHS, SkyHead
from radcam_depth_ros.networks.layers.image_statistics import ImageStatistics
from radcam_depth_ros.networks.migration import completed

SMALL = {"channels": [8, 8, 8, 8]}
TOLD = torch.tensor([[0.0, 1 / 630 / 1.5, -0.02, 1.0]])


def outputs_of(ground: torch.Tensor) -> tuple[Baff, TrainOutputs]:
    torch.manual_seed(0)
    network = networks.create("baff", SMALL).eval()
    assert isinstance(network, Baff)
    for module in (network.mix, network.road):
        assert module is not None
        with torch.no_grad():
            for values in module.parameters():
                values.add_(0.3 * torch.randn_like(values))
    radar = torch.tensor([[[40.0, 40.0, 12.0, 5.0, 1.0, 0.1], [70.0, 20.0, 30.0, 5.0, 1.0, 0.1]]])
    outputs = network.train_outputs(torch.rand(1, 3, 64, 96), radar, torch.ones(1, 2, dtype=torch.bool), ground)
    return network, outputs


def test_the_depth_lies_between_the_networks_and_geometrys() -> None:
    generator = torch.Generator().manual_seed(1)
    mix = GeometryMix(8, 2).eval()
    with torch.no_grad():
        mix.head.weight.normal_(std=1.0, generator=generator)
    depth, geometry = torch.rand(2, 1, 1, 16, 24, generator=generator)
    features = torch.rand(1, 8, 8, 12, generator=generator)
    sky, planes = torch.rand(1, WIDTHS[2], 8, 12), torch.rand(1, PLANES - 3, 8, 12)
    mixed, confidence = mix(torch.rand(1, 3, 32, 48), torch.tensor([[5]]), features, sky, planes, depth, geometry)
    low, high = torch.minimum(depth, geometry), torch.maximum(depth, geometry)
    assert ((mixed >= low - 1e-6) & (mixed <= high + 1e-6)).all()
    assert (mixed != depth).any()
    assert confidence.shape == depth.shape


def test_geometry_has_the_road_as_told_whatever_the_image_shows() -> None:
    network, outputs = outputs_of(TOLD)
    assert outputs.geometry_m is not None
    assert outputs.road_m is not None
    told_m = network._depth(network.rasterise.road(TOLD, 64, 96))
    assert (outputs.geometry_m <= told_m + 1e-5).all()
    assert (outputs.road_m - told_m).abs().max() > 0.01, "the votes see another road"


def test_a_told_road_is_used_to_the_digit_and_an_assumed_one_is_corrected() -> None:
    torch.manual_seed(0)
    network = networks.create("baff", SMALL).eval()
    assert isinstance(network, Baff)
    assert network.road is not None
    with torch.no_grad():
        network.road.votes.weight.normal_(std=0.3)
    maps = [torch.randn(1, 8, 16 >> level, 24 >> level) for level in range(4)]
    used, seen = network._roads(maps, TOLD)
    assert torch.equal(used, TOLD)
    assert not torch.equal(seen, TOLD)
    assumed = TOLD * torch.tensor([1.0, 1.0, 1.0, 0.0])
    used, seen = network._roads(maps, assumed)
    assert torch.equal(used, seen)


def test_the_sky_has_half_the_size_and_is_a_probability() -> None:
    head = SkyHead((8, 8, 8, 8)).eval()
    maps = [torch.randn(1, 8, 16 >> level, 24 >> level) for level in range(4)]
    logit, features = head(torch.rand(1, 3, 64, 96), maps, torch.rand(1, 1, 16, 24))
    assert (logit.shape, features.shape) == ((1, 1, 32, 48), (1, WIDTHS[2], 16, 24))


def test_statistics_tell_black_from_noise() -> None:
    measure = ImageStatistics()
    black, noise = measure(torch.zeros(1, 3, 64, 96)), measure(torch.rand(1, 3, 64, 96))
    assert torch.isfinite(black).all()
    assert black.shape == (1, ImageStatistics.COUNT)
    assert (black[0, 0], black[0, 5]) == (0, 1)
    assert noise[0, 2] > black[0, 2]


@pytest.mark.parametrize("network", ["baff", "baseline"])
def test_a_card_without_the_key_is_of_a_network_without_the_mix(network: str) -> None:
    assert completed(network, {"threshold": 0.25}) == {"geometry_mix": False, "threshold": 0.25}
    assert completed(network, {"geometry_mix": True}) == {"geometry_mix": True}
    assert completed("lircdepth", {}) == {}
