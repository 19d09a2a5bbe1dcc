"""Returns drawn as an image of several channels."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from radcam_depth_ros.networks.layers.radar_channels import draw_planes

NAN = float("nan")


def draw(*rows: list[float]) -> Tensor:
    """Planes of an image of 4 x 6 pixels; rows are u, v, depth, RCS, speed."""
    radar = torch.zeros(1, len(rows), 6)
    radar[0, :, :5] = torch.tensor(rows).reshape(-1, 5)
    return draw_planes(radar, torch.ones(1, len(rows), dtype=torch.bool), 4, 6, 100.0)[0]


def test_a_return_is_drawn_with_all_that_is_known_of_it() -> None:
    planes = draw([2.0, 1.0, 25.0, 10.0, -5.0])
    assert planes.shape == (4, 4, 6)
    assert planes[:, 1, 2].tolist() == pytest.approx([0.25, 0.5, -0.25, 1.0])
    planes[:, 1, 2] = 0.0
    assert not planes.any()


def test_the_nearest_return_of_a_pixel_wins_in_every_channel() -> None:
    planes = draw([2.0, 1.0, 50.0, 40.0, 20.0], [2.3, 0.8, 25.0, -10.0, -5.0], [2.0, 1.0, 90.0, 0.0, 60.0])
    assert planes[:, 1, 2].tolist() == pytest.approx([0.25, -0.5, -0.25, 1.0])


def test_what_a_sensor_does_not_measure_is_zero_and_said_to_be_unknown() -> None:
    assert draw([2.0, 1.0, 25.0, NAN, -5.0])[:, 1, 2].tolist() == pytest.approx([0.25, 0.0, -0.25, 0.5])
    assert draw([2.0, 1.0, 25.0, NAN, NAN])[:, 1, 2].tolist() == pytest.approx([0.25, 0.0, 0.0, 0.0])


def test_values_are_limited() -> None:
    assert draw([0.0, 0.0, 300.0, 1e6, -1e6])[:, 0, 0].tolist() == pytest.approx([1.0, 5.0, -3.0, 1.0])
    assert not draw([9.0, 0.0, 3.0, 1.0, 1.0]).any()
    assert not draw().any()
