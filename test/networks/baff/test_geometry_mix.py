"""The dense depth as a mix of the network's and geometry's, and the sky."""

from __future__ import annotations

import math

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks import TrainOutputs
from radcam_depth_ros.networks.baff.geometry_mix import PLANES, GeometryMix
from radcam_depth_ros.networks.baff.ground_refinement import RoadDoubt, RoadVotes
from radcam_depth_ros.networks.baff.network import Baff
from radcam_depth_ros.networks.baff.sky import SkyHead
from radcam_depth_ros.networks.layers.image_statistics import TYPICAL, FrameStatistics, ImageStatistics
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
    depth, told, used = torch.rand(3, 1, 1, 16, 24, generator=generator)
    features = torch.rand(1, 8, 8, 12, generator=generator)
    planes, statistics = torch.rand(1, PLANES - 3, 8, 12), torch.rand(1, FrameStatistics.COUNT)
    mixed, confidence = mix(statistics, features, planes, depth, torch.zeros_like(depth), told, used)
    experts = torch.stack([depth, told, used])
    low, high = experts.amin(dim=0), experts.amax(dim=0)
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
    image, statistics = torch.rand(1, 3, 64, 96), torch.zeros(1, FrameStatistics.COUNT)
    roads = network._roads(maps, TOLD, statistics, image)
    assert torch.equal(roads.used, roads.told)
    assert not torch.equal(roads.seen, roads.told)
    assumed = TOLD * torch.tensor([1.0, 1.0, 1.0, 0.0])
    roads = network._roads(maps, assumed, statistics, image)
    assert torch.equal(roads.used, roads.seen)
    assert not torch.equal(roads.used, roads.told)


def test_votes_that_abstain_leave_the_road_and_make_it_uncertain() -> None:
    torch.manual_seed(0)
    votes = RoadVotes((8, 8, 8, 8)).eval()
    with torch.no_grad():
        votes.votes.weight.normal_(std=0.3)
    maps = [torch.randn(1, 8, 16 >> level, 24 >> level) for level in range(4)]
    road_m = torch.full((1, 1, 8, 12), 10.0)
    heard, covariance = votes(maps, TOLD, torch.ones(1, 1))
    certain = votes.deviation(covariance, TOLD, road_m, 8.0)
    silent, covariance = votes(maps, TOLD, torch.zeros(1, 1))
    uncertain = votes.deviation(covariance, TOLD, road_m, 8.0)
    assert (heard - TOLD).abs().max() > 1e-6
    torch.testing.assert_close(silent, TOLD)
    assert (uncertain > certain).all()
    torch.testing.assert_close(covariance, covariance.transpose(1, 2))


def test_how_much_votes_count_depends_on_the_frame() -> None:
    torch.manual_seed(0)
    doubt = RoadDoubt().eval()
    with torch.no_grad():
        doubt.gate.last.weight.normal_()
    heard, variance = doubt(torch.randn(4, FrameStatistics.COUNT))
    assert heard.shape == (4, 1)
    assert ((heard > 0) & (heard < 1)).all()
    assert heard.std() > 0.01
    assert variance.item() == pytest.approx(math.exp(-2), rel=1e-5)


def test_a_corrected_roads_deviation_is_that_of_its_samples() -> None:
    """Errors of the three coefficients, drawn by the covariance, make errors of depth of the deviation that is told."""
    votes = RoadVotes((8, 8, 8, 8)).eval()
    root = 0.02 * torch.tensor([[1.0, 0.0, 0.0], [0.3, 0.8, 0.0], [-0.5, 0.2, 1.2]])
    rows, columns = 4, 6
    inverse = (TOLD[0, 1] * (100.0 + 8.0 * torch.arange(rows))).reshape(1, 1, -1, 1).expand(1, 1, rows, columns)
    told = votes.deviation((root @ root.T).unsqueeze(0), TOLD, 1.0 / inverse, 8.0)
    drawn = torch.randn(20000, 3, generator=torch.Generator().manual_seed(0)) @ root.T
    x, y = votes._places(columns, torch.device("cpu"), 8.0), votes._places(rows, torch.device("cpu"), 8.0)
    moved = drawn[:, 0, None, None] * x + drawn[:, 1, None, None] * y[:, None] + drawn[:, 2, None, None]
    observed = (votes.vote_rows * TOLD[0, 1] * moved / inverse[0]).std(dim=0)
    torch.testing.assert_close(observed, told[0, 0], rtol=0.03, atol=0)


def test_the_sky_has_half_the_size_and_is_a_probability() -> None:
    maps = [torch.randn(1, 8, 16 >> level, 24 >> level) for level in range(4)]
    logit = SkyHead((8, 8, 8, 8)).eval()(torch.rand(1, 3, 64, 96), maps, maps[0], torch.rand(1, 3, 16, 24))
    assert (logit.shape, logit.dtype) == ((1, 1, 32, 48), torch.float32)


def test_statistics_tell_black_from_noise() -> None:
    measure = ImageStatistics()
    black, noise = measure(torch.zeros(1, 3, 64, 96)), measure(torch.rand(1, 3, 64, 96))
    assert torch.isfinite(black).all()
    assert black.shape == (1, ImageStatistics.COUNT)
    assert (black[0, 0], black[0, 5]) == (0, 1)
    assert noise[0, 2] > black[0, 2]


def test_statistics_of_a_usual_frame_are_small() -> None:
    measure, valid = FrameStatistics(), torch.ones(1, 42, dtype=torch.bool)
    assert len(TYPICAL) == FrameStatistics.COUNT == ImageStatistics.COUNT + 1
    grey = torch.nn.functional.interpolate(torch.rand(1, 1, 8, 12), (64, 96), mode="bilinear").expand(1, 3, -1, -1)
    usual, black = measure(grey, valid), measure(torch.zeros(1, 3, 64, 96), valid)
    assert float(black.abs().max()) > 3 > float(usual[:, [0, 1, 9]].abs().max())


@pytest.mark.parametrize("network", ["baff", "baseline"])
def test_a_card_without_the_key_is_of_a_network_without_the_mix(network: str) -> None:
    former = {"geometry_mix": False, "full_size": False, "hint": False, "context": "none", "familiar": 0.0}
    assert completed(network, {"threshold": 0.25}) == {**former, "threshold": 0.25}
    assert completed(network, {"geometry_mix": True}) == {**former, "geometry_mix": True}
    assert completed("lircdepth", {}) == {"sky": False, "familiar": 0.0}
    assert completed("structured", {}) == {"familiar": 0.0}
