"""Returns as planes: layers, profiles and their peaks."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from radcam_depth_ros.networks.layers.rasterise import Rasterise, depth_to_plane, peak, plane_to_depth, support


def layers(radar: list[list[float]], valid: list[bool]) -> Tensor:
    """Quantiles 0.5, 0.1, 0.3, 0.7, 0.9 of returns (u, v, depth) on an image of 64 x 96 pixels, metres."""
    rows = torch.tensor([[[*row, 0.0, 0.0, 0.0] for row in radar]])
    rasterise = Rasterise(1.0, 100.0, ground_prior=True, returns_per_cell=16, detail=2)
    geometry = rasterise(rows, torch.tensor([valid]), torch.full((1, 4), float("nan")), 64, 96)
    return plane_to_depth(geometry.layers, 1.0, 100.0)


def test_layers_of_returns_go_from_near_to_far() -> None:
    radar = [[40.0, 40.0, 30.0], [40.0, 40.0, 10.0], [40.0, 40.0, 20.0]]
    found = layers(radar, [True, True, True])
    expected = torch.tensor([20.0, 10.0, 30.0]).reshape(1, 3, 1, 1)
    torch.testing.assert_close(found, expected.expand(1, 3, 16, 24), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(layers(radar, [True, False, False]), torch.full_like(found, 30.0), rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(layers(radar, [False] * 3), torch.full_like(found, 100.0), rtol=1e-4, atol=1e-4)


def test_a_layer_follows_the_returns_nearby() -> None:
    middle = layers([[8.0, 32.0, 10.0], [88.0, 32.0, 50.0]], [True, True])[0, 0]
    assert middle[8, 2] == pytest.approx(10.0, rel=1e-4)
    assert middle[8, 20] == pytest.approx(50.0, rel=1e-4)


def profile_of(radar: list[list[float]], width: int = 96) -> Tensor:
    """How many of the returns (u, v, depth) are at a depth, by column of an image of that width."""
    rows = torch.tensor([[[*row, 0.0, 0.0, 0.0] for row in radar]])
    rasterise = Rasterise(1.0, 100.0, ground_prior=True, returns_per_cell=8, detail=2)
    return rasterise(
        rows, torch.ones(1, len(radar), dtype=torch.bool), torch.full((1, 4), float("nan")), 64, width
    ).profile


def test_a_profile_counts_returns_of_a_column_whatever_their_row() -> None:
    profile = profile_of([[40.0, 3.0, 20.0], [41.0, 60.0, 20.0], [42.0, -30.0, 20.0], [90.0, 30.0, 50.0]])
    assert profile.shape == (1, 48, 24)
    planes = depth_to_plane(torch.tensor([20.0, 50.0]), 1.0, 100.0).reshape(1, 2, 1, 1).expand(1, 2, 1, 24)
    counts = torch.expm1(support(profile, planes))[0, :, 0]
    # Depths lie between two bins, which share a return: of what is at one depth all is found, or nearly.
    assert 1.5 <= counts[0, 10] <= 3.0
    assert counts[1, 10] == 0
    assert 0.5 <= counts[1, 22] <= 1.0
    # Half of it in the strips beside, nothing farther off.
    assert counts[0, 6] == pytest.approx(0.5 * counts[0, 10])
    assert counts[0, 2] == 0


def test_the_peak_is_where_most_returns_are() -> None:
    found = peak(profile_of([[40.0, 3.0, 20.0], [41.0, 60.0, 20.5], [42.0, 9.0, 70.0]]))
    assert found.shape == (1, 1, 1, 24)
    assert float(plane_to_depth(found, 1.0, 100.0)[0, 0, 0, 10]) == pytest.approx(20.2, rel=0.02)
    assert float(plane_to_depth(found, 1.0, 100.0)[0, 0, 0, 20]) == pytest.approx(100.0)
