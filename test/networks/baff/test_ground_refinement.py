"""The plane through the votes."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from radcam_depth_ros.networks.baff.ground_refinement import SPAN_PX, VOTE_ROWS, RoadVotes
from radcam_depth_ros.networks.baff.network import Baff
from radcam_depth_ros.networks.weights_io import archive

CHANNELS = (8, 8, 8, 8)
ROWS, COLUMNS = 4, 6
TOLD = torch.tensor([[0.0, 1 / 630 / 1.5, -0.03, 1.0]])


class _Given(nn.Module):
    """A module that gives the same whatever it is asked."""

    def __init__(self, value: Tensor) -> None:
        super().__init__()
        self.value = value

    def forward(self, *_: Tensor) -> Tensor:
        return self.value


def road_of(votes: Tensor) -> RoadVotes:
    """Corrects a road by votes (B, 2, rows, columns) that are given, in place of those that an image says."""
    road = RoadVotes(CHANNELS)
    road.up, road.features, road.votes = _Given(votes), nn.Identity(), nn.Identity()  # type: ignore[assignment]  # stand-ins
    return road


NO_MAPS = [torch.zeros(1)] * 4
HEARD = torch.ones(1, 1)


def planar(x: float, y: float, z: float, weight: float) -> Tensor:
    """Votes (1, 2, rows, columns) that lie in a plane over spans from the image's middle."""
    across = (torch.arange(COLUMNS) + 0.5 - COLUMNS / 2) * 16 / SPAN_PX
    along = (torch.arange(ROWS) + 0.5 - ROWS / 2) * 16 / SPAN_PX
    rows = x * across.reshape(1, -1) + y * along.reshape(-1, 1) + z
    return torch.stack([rows, torch.full_like(rows, weight)]).unsqueeze(0)


def test_an_untrained_correction_changes_nothing() -> None:
    votes = RoadVotes(CHANNELS).eval()
    maps = [torch.rand(1, 8, 2 * ROWS // 2**index, 2 * COLUMNS // 2**index) for index in range(2)]
    with torch.no_grad():
        corrected, _ = votes([maps[0], maps[0], maps[0], maps[1]], TOLD, HEARD)
    torch.testing.assert_close(corrected, TOLD)


@settings(max_examples=30, deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_the_plane_goes_through_votes_that_agree(x: float, y: float, z: float) -> None:
    road = road_of(planar(x, y, z, 8.0))
    with torch.no_grad():
        road.trust.fill_(-20.0)
        a, b, c, known = road(NO_MAPS, TOLD, HEARD)[0][0]
    step = VOTE_ROWS / 630 / 1.5
    u, v = 70.0, 20.0
    # In pixels, of which the middle of an image of 64 x 96 lies between two.
    moved = step * (x * (u - 47.5) / SPAN_PX + y * (v - 31.5) / SPAN_PX + z)
    expected = float(TOLD[0, 1]) * v - 0.03 + moved
    assert float(a) * u + float(b) * v + float(c) == pytest.approx(expected, abs=2e-5)
    assert known == 1


def test_votes_move_an_assumed_road_more_than_a_known_one() -> None:
    road = road_of(planar(0.0, 0.0, 1.0, 0.0))
    assumed = TOLD * torch.tensor([1.0, 1.0, 1.0, 0.0])
    with torch.no_grad():
        moved = [float((road(NO_MAPS, ground, HEARD)[0] - ground)[0, 2]) for ground in (TOLD, assumed)]
    assert 0 < moved[0] < moved[1] < VOTE_ROWS / 630 / 1.5


def test_where_nothing_is_told_nothing_comes_out_and_gradients_stay_finite() -> None:
    road = road_of(planar(0.1, 0.2, 0.3, 1.0).expand(2, -1, -1, -1))
    ground = torch.cat([TOLD, torch.full((1, 4), float("nan"))])
    corrected, _ = road(NO_MAPS, ground, HEARD)
    assert torch.isfinite(corrected[0]).all()
    assert torch.isnan(corrected[1, :3]).all()
    torch.nan_to_num(corrected).sum().backward()
    gradient = road.trust.grad
    assert gradient is not None
    assert torch.isfinite(gradient).all()


@pytest.mark.parametrize("picture", ["black", "grey", "noise"])
def test_the_shipped_network_keeps_an_assumed_height_where_the_picture_tells_nothing(picture: str) -> None:
    network = archive.load("baff").network
    assert isinstance(network, Baff)
    assert network.road is not None
    assert network.doubt is not None
    generator = torch.Generator().manual_seed(0)
    height, width, focal_length, assumed_m = 320, 640, 630.0, 1.4
    image = {
        "black": torch.zeros(1, 3, height, width),
        "grey": torch.full((1, 3, height, width), 0.5),
        "noise": torch.rand(1, 3, height, width, generator=generator),
    }[picture]
    returns = 60
    place = torch.rand(1, returns, 3, generator=generator) * torch.tensor([width, height, 70.0]) + torch.tensor(
        [0, 0, 4]
    )
    radar = torch.cat([place, torch.zeros(1, returns, 3)], dim=2)
    ground = torch.tensor([[0.0, 1.0, 0.5 - height / 2, 0.0]]) / (focal_length * assumed_m)
    with torch.inference_mode():
        valid = torch.ones(1, returns, dtype=torch.bool)
        geometry = network.rasterise(radar, valid, ground, height, width)
        maps = network.encoder(image, geometry.prior, network._context(image))
        heard, _ = network.doubt(network.statistics(image, valid))
        ((a, b, c, _),) = network.road(maps, ground, heard)[0].tolist()
    middle = c + a * (width - 1) / 2 + b * (height - 1) / 2
    kept_m = 1 / math.hypot(a * focal_length, b * focal_length, middle)
    assert kept_m == pytest.approx(assumed_m, rel=0.03)
