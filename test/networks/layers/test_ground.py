"""The flat road as a part of networks."""

from __future__ import annotations

import math

import torch

from radcam_depth_ros.networks.layers.ground import GroundPrior

LEVEL = torch.tensor([[0.0, 1 / 945.0, -32 / 945.0, 1.0]])
"""Horizon at row 32, focal length 630 px, camera at 1.5 m: row 95 is 15 m away."""


def test_the_roads_share_leads_from_the_networks_depth_to_the_roads() -> None:
    prior = GroundPrior(4, 1.0, 100.0)
    own = torch.full((1, 1, 96, 64), 40.0)
    with torch.inference_mode():
        none, half, all_of_it = (prior.blend(own, torch.full_like(own, gate), LEVEL) for gate in (-50.0, 0.0, 50.0))
    torch.testing.assert_close(none, own)
    assert all_of_it[0, 0, 95, 0].item() == 15.0
    # Above the horizon the road is as far as anything can be.
    torch.testing.assert_close(all_of_it[0, 0, :32], torch.full((32, 64), 100.0))
    torch.testing.assert_close(half, (own + all_of_it) / 2)


def test_without_a_road_the_networks_depth_stays() -> None:
    prior = GroundPrior(4, 1.0, 100.0)
    own = torch.rand(2, 1, 64, 64) * 50 + 1
    ground = torch.cat([LEVEL, torch.tensor([[math.nan, math.nan, math.nan, 0.0]])])
    with torch.inference_mode():
        blended = prior.blend(own, torch.full_like(own, 50.0), ground)
        seen = prior(ground, torch.zeros(2, 4, 2, 2))
    torch.testing.assert_close(blended[1], own[1], rtol=0, atol=0)
    assert not torch.equal(blended[0], own[0])
    assert seen.shape == (2, 4, 2, 2)
    assert torch.isfinite(seen).all()
