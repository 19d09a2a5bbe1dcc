"""Patches around returns."""

from __future__ import annotations

import math
from random import Random

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from radcam_depth_ros.networks.layers.patches import alike, around, covered

HEIGHT, WIDTH = 7, 9


def returns(*rows: tuple[float, float, float]) -> tuple[Tensor, Tensor]:
    """Returns (u, v, depth) of one image, all valid."""
    radar = torch.zeros(1, len(rows), 6)
    radar[0, :, :3] = torch.tensor(rows).reshape(-1, 3)
    return radar, torch.ones(1, len(rows), dtype=torch.bool)


def test_a_patch_is_around_its_return_and_cut_at_the_border() -> None:
    radar, valid = returns((0.4, 6.0, 10.0))
    patches = around(radar, valid, HEIGHT, WIDTH, (5, 3))
    assert patches.pixels.shape == patches.there.shape == (1, 1, 15)
    reached = covered(patches, HEIGHT, WIDTH)
    expected = torch.zeros(1, 1, HEIGHT, WIDTH, dtype=torch.bool)
    expected[0, 0, 4:, :2] = True
    assert torch.equal(reached, expected)
    assert not covered(around(radar, ~valid, HEIGHT, WIDTH, (5, 3)), HEIGHT, WIDTH).any()


def test_without_returns_there_is_no_patch() -> None:
    radar, valid = returns()
    patches = around(radar, valid, HEIGHT, WIDTH, (5, 3))
    assert not covered(patches, HEIGHT, WIDTH).any()
    assert torch.isnan(alike(patches, radar, torch.full((1, 1, HEIGHT, WIDTH), 10.0), 0.1)).all()


def test_a_pixel_takes_the_depth_most_like_its_own() -> None:
    radar, valid = returns((4.0, 3.0, 10.0), (4.0, 3.0, 10.5), (4.0, 3.0, 30.0))
    depth_m = torch.full((1, 1, HEIGHT, WIDTH), 10.4)
    depth_m[0, 0, 3, 4], depth_m[0, 0, 4, 4], depth_m[0, 0, 2, 4] = 10.1, 29.0, 20.0
    found = alike(around(radar, valid, HEIGHT, WIDTH, (3, 3)), radar, depth_m, 0.1)[0, 0]
    assert float(found[3, 4]) == 10.0
    assert float(found[4, 4]) == 30.0
    assert math.isnan(float(found[2, 4]))  # none is within a tenth of 20 m
    assert float(found[3, 3]) == 10.5
    assert int((~torch.isnan(found)).sum()) == 8


@settings(max_examples=20, deadline=None)
@given(
    rows=st.lists(st.tuples(st.floats(-3, 12), st.floats(-3, 10), st.sampled_from([9.0, 10.0, 11.0])), max_size=6),
    order=st.randoms(use_true_random=False),
)
def test_the_order_of_the_returns_does_not_matter(rows: list[tuple[float, float, float]], order: Random) -> None:
    depth_m = torch.linspace(8.0, 12.0, HEIGHT * WIDTH).reshape(1, 1, HEIGHT, WIDTH)
    shuffled = list(rows)
    order.shuffle(shuffled)
    found = []
    for entries in (rows, shuffled):
        radar, valid = returns(*entries)
        found.append(alike(around(radar, valid, HEIGHT, WIDTH, (3, 3)), radar, depth_m, 0.2))
    torch.testing.assert_close(*found, rtol=0, atol=0, equal_nan=True)
    known = ~torch.isnan(found[0])
    assert ((found[0] - depth_m).abs()[known] < 0.2 * depth_m[known]).all()


@pytest.mark.parametrize("tolerance", [0.05, 0.3])
def test_samples_of_a_batch_have_returns_of_their_own(tolerance: float) -> None:
    first, valid = returns((4.0, 3.0, 10.0))
    second, _ = returns((1.0, 1.0, 12.0))
    both = torch.cat([first, second])
    depth_m = torch.full((2, 1, HEIGHT, WIDTH), 11.0)
    patches = around(both, valid.expand(2, -1), HEIGHT, WIDTH, (3, 3))
    found = alike(patches, both, depth_m, tolerance)
    for index, radar in enumerate((first, second)):
        alone = alike(around(radar, valid, HEIGHT, WIDTH, (3, 3)), radar, depth_m[:1], tolerance)
        torch.testing.assert_close(found[index : index + 1], alone, equal_nan=True)
