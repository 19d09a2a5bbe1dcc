"""Doubtful depths."""

from __future__ import annotations

import math

import pytest
import torch

from radcam_depth_ros import networks
from radcam_depth_ros.networks import ArchitectureError
from radcam_depth_ros.networks.layers.caution import DOUBT_SPAN, LEAN, STRANGE, Caution, CautiousDepth
from radcam_depth_ros.networks.layers.rasterise import depth_to_plane, plane_to_depth


def test_a_doubtful_depth_leans_to_what_is_near() -> None:
    plane = depth_to_plane(torch.tensor([[[[40.0, 40.0, 40.0, 5.0]]]]), 1.0, 100.0)
    near = depth_to_plane(torch.full((1, 1, 1, 4), 10.0), 1.0, 100.0)
    # Confidence: none, half way down, above the limit, none where the returns are farther away.
    logit = torch.logit(torch.tensor([[[[0.01, 0.5 - 0.5 * DOUBT_SPAN, 0.6, 0.01]]]]))
    leant = plane_to_depth(Caution(0.5, 0.0)(plane, logit, near), 1.0, 100.0).flatten()
    expected = torch.tensor([40.0 / 4.0**LEAN, 40.0 / 4.0 ** (0.5 * LEAN), 40.0, 5.0])
    torch.testing.assert_close(leant, expected, rtol=1e-4, atol=0.0)
    torch.testing.assert_close(Caution(0.0, 0.0)(plane, logit, near), plane)


def test_doubtful_depths_of_a_familiar_picture_stay() -> None:
    share = torch.tensor([0.4, 0.5 * 0.4 * (1 + STRANGE), 0.4 * STRANGE, 0.0])
    sure = torch.arange(100.0).reshape(1, 1, 1, 100) < (100 * share).round().reshape(4, 1, 1, 1)
    logit = torch.where(sure, 9.0, -9.0)
    plane, near = torch.full_like(logit, 0.8), torch.full_like(logit, 0.3)
    moved = (plane - Caution(0.5, 0.4)(plane, logit, near))[..., -1].flatten()
    torch.testing.assert_close(moved, 0.5 * LEAN * torch.tensor([0.0, 0.5, 1.0, 1.0]), rtol=0.05, atol=1e-6)


def test_geometry_is_the_road_or_the_nearest_return_in_the_image() -> None:
    cautious = CautiousDepth(0.7, 0.0, 1.0, 100.0)
    dense = torch.full((1, 1, 64, 96), 90.0)
    radar, valid = torch.tensor([[[16.0, 8.0, 20.0, 0.0, 0.0, 0.0]]]), torch.tensor([[True]])
    # A road from row 32 on; it is 10 m away in the last row.
    ground = torch.tensor([[0.0, 0.1 / 31, -3.2 / 31, 1.0]])
    with torch.inference_mode():
        doubted, sure = (cautious(dense, torch.full_like(dense, logit), radar, valid, ground) for logit in (-9.0, 9.0))
        nothing = cautious(dense, torch.full_like(dense, -9.0), radar, ~valid, torch.full((1, 4), math.nan))
    torch.testing.assert_close(sure, dense)
    assert doubted[0, 0, 8, 16].item() == pytest.approx(90 * (20 / 90) ** LEAN, rel=1e-3)
    assert doubted[0, 0, 62, 16].item() == pytest.approx(90 * (10 / 90) ** LEAN, rel=0.1)
    torch.testing.assert_close(nothing, dense)


@pytest.mark.parametrize("key", ["caution", "familiar"])
@pytest.mark.parametrize("name", ["baff", "lircdepth", "structured"])
def test_caution_is_a_probability_and_what_is_familiar_a_share(name: str, key: str) -> None:
    with pytest.raises(ArchitectureError, match=rf"{key} must lie between 0 and 1, got 1\.5"):
        networks.create(name, {key: 1.5})
