"""What computes in float32 does so whatever the format around it, and depth has no steps of bfloat16."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from radcam_depth_ros.engine import Engine
from radcam_depth_ros.networks.baff.ground_refinement import RoadVotes
from radcam_depth_ros.networks.layers.blocks import PlanarConv
from radcam_depth_ros.networks.layers.number_formats import Float32Conv2d, InFloat32, convert
from radcam_depth_ros.networks.weights_io import archive, torchscript

FORMATS = ("float32", "bfloat16")
CHANNELS = (8, 8, 8, 8)


def road_votes() -> RoadVotes:
    torch.manual_seed(0)
    road = RoadVotes(CHANNELS)
    with torch.no_grad():
        road.votes.weight.normal_(std=0.3)
    return road


def maps() -> list[Tensor]:
    generator = torch.Generator().manual_seed(1)
    return [torch.randn(2, 8, 112 >> level, 192 >> level, generator=generator) for level in range(4)]


HEARD = torch.ones(2, 1)
GROUND = torch.tensor([[0.0, 1 / 630 / 1.5, -0.03, 1.0], [1e-6, 1 / 630 / 2.0, -0.02, 0.0]])


@pytest.mark.parametrize("kind", [Float32Conv2d, PlanarConv])
def test_a_float32_layer_computes_in_it_under_autocast_and_within_a_converted_network(kind: type[InFloat32]) -> None:
    generator = torch.Generator().manual_seed(3)
    bias = torch.rand(3, generator=generator)
    layer = PlanarConv(4, bias) if kind is PlanarConv else Float32Conv2d(4, 3, 3, padding=1)
    with torch.no_grad():
        layer.weight.normal_(generator=generator)
        layer.bias.copy_(bias)
    x = torch.randn(1, 4, 8, 12, generator=generator).bfloat16()
    expected = layer(x.float())
    with torch.autocast("cpu", torch.bfloat16):
        under_autocast = layer(x)
    converted = convert(nn.Sequential(layer), torch.bfloat16)
    scripted = torchscript.freeze(converted, torch.bfloat16)
    for result in (under_autocast, converted(x), scripted(x)):
        assert result.dtype == torch.float32
        # Kernels sum up in different orders, 1e-6 apart; in bfloat16 it would be off by 1e-2 and more.
        torch.testing.assert_close(result, expected, rtol=1e-6, atol=1e-5)


def test_conversion_rounds_all_but_what_keeps_float32() -> None:
    network = convert(road_votes(), torch.bfloat16)
    kept = {name for name, value in network.named_parameters() if value.dtype == torch.float32}
    assert kept == {"votes.weight", "votes.bias", "trust"}
    assert {value.dtype for name, value in network.named_parameters() if name not in kept} == {torch.bfloat16}


def test_the_plane_of_the_road_is_fitted_in_float32_whatever_autocast_says() -> None:
    """From the same votes the plane must be the same to float32's rounding: in bfloat16 it would be off by 0.4 %."""
    road = road_votes().eval()
    votes = torch.randn(2, 2, 7, 12, generator=torch.Generator().manual_seed(2))
    road.votes.register_forward_hook(lambda *_: votes)
    with torch.inference_mode():
        expected, _ = road(maps(), GROUND, HEARD)
        with torch.autocast("cpu", torch.bfloat16):
            result, _ = road(maps(), GROUND, HEARD)
    assert result.dtype == torch.float32
    torch.testing.assert_close(result, expected, rtol=1e-6, atol=1e-9)


def test_the_corrected_road_learns_under_autocast() -> None:
    road = road_votes()
    with torch.autocast("cpu", torch.bfloat16):
        corrected, _ = road(maps(), GROUND, HEARD)
    corrected.square().sum().backward()  # type: ignore[no-untyped-call]  # torch's annotation is missing
    assert all(torch.isfinite(parameter.grad).all() for parameter in road.parameters() if parameter.grad is not None)
    assert road.votes.weight.grad is not None


def road_image(height: int = 256, width: int = 448) -> tuple[Tensor, Tensor, Tensor]:
    """A smooth road below a sky, three returns on it, and its plane as told."""
    horizon = 0.45 * height
    rows = torch.arange(height).reshape(-1, 1, 1).expand(-1, width, 3)
    image = torch.where(rows < horizon, 200.0, 80.0 + 0.1 * (rows - horizon)).byte().contiguous()
    slope = 1 / (630.0 * 1.5)
    radar = torch.tensor([[60.0, 175.0, 16.0], [220.0, 153.0, 25.0], [390.0, 215.0, 9.5]])
    radar = torch.cat([radar, torch.zeros(3, 3)], dim=1)
    return image, radar, torch.tensor([0.0, slope, -slope * horizon, 1.0])


@pytest.mark.parametrize(
    "name", ["baff", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("structured", "lircdepth"))]
)
def test_a_smooth_road_has_no_steps_in_bfloat16_that_float32_does_not_have(name: str) -> None:
    """A step: neighbours down a column with the same depth to the digit, or a leap after them."""
    network = archive.load(name).network
    plateaus, leaps = {}, {}
    for precision in FORMATS:
        dense = Engine(network, precision=precision).run(*road_image()).dense[0, 0].numpy()
        columns = np.log(dense[170:250, 32:416:8])
        slopes = np.diff(columns, axis=0)
        plateaus[precision] = float((slopes == 0).mean())
        leaps[precision] = float(np.quantile(np.abs(np.diff(slopes, axis=0)), 0.9))
    assert plateaus["bfloat16"] <= plateaus["float32"] + 0.001
    assert leaps["bfloat16"] <= 1.25 * leaps["float32"] + 2e-4
