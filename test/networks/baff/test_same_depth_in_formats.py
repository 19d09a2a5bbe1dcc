"""The depth of `baff` is the same in float32 and bfloat16, but for 1 % in nearly all pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from radcam_depth_ros import configuration, networks, simulation
from radcam_depth_ros.drive import read_samples
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.networks.layers.number_formats import Float32Linear, RawConv2d, convert
from radcam_depth_ros.simulation import SimulationConfig

MOST = 0.01
"""The largest relative difference that 95 % of the pixels of a frame may have."""

FRAMES = 4
CAMERA = {"rate_hz": 0.5, "width": 640, "min_width": 480, "height": 384, "min_height": 240}


def differences(seed: int, folder: Path, estimators: list[Estimator]) -> list[float]:
    """The 95th percentile of |bfloat16 / float32 - 1| of each frame of a simulated drive."""
    values = {"camera": CAMERA, "key_frames": True, "lidar": {"enabled": False}}
    path = folder / str(seed)
    simulation.simulate(configuration.build(SimulationConfig, values), seed, FRAMES, path)
    found: list[float] = []
    for sample in read_samples(path):
        reference, dense = (estimator.estimate(sample.frame).dense for estimator in estimators)
        found.append(float(np.quantile(np.abs(dense / reference - 1.0), 0.95)))
    return found


@pytest.fixture(scope="module")
def estimators() -> list[Estimator]:
    return [Estimator(EstimatorConfig(precision=precision, threads=1)) for precision in ("float32", "bfloat16")]


@pytest.mark.slow
def test_depth_of_a_drive_is_within_a_hundredth(tmp_path: Path, estimators: list[Estimator]) -> None:
    found = differences(1_000_000, tmp_path, estimators)
    assert len(found) == FRAMES
    assert 0.0 < max(found) < MOST


@pytest.mark.endurance
@pytest.mark.timeout(3600)
def test_depth_of_a_hundred_frames_is_within_a_hundredth(tmp_path: Path, estimators: list[Estimator]) -> None:
    found = [value for seed in range(1_000_001, 1_000_026) for value in differences(seed, tmp_path, estimators)]
    assert len(found) == 100
    assert max(found) < MOST


def test_the_first_layers_of_raw_values_keep_float32_and_give_the_networks_format() -> None:
    network = convert(networks.create("baff", {"channels": [8, 8, 8, 8]}).eval(), torch.bfloat16)
    first = ("encoder.stem.0.0", "encoder.join.0", "fusion.depth_encoder.levels.0.0")
    for name in first:
        layer = network.get_submodule(name)
        assert isinstance(layer, RawConv2d), name
        assert layer.weight.dtype == torch.float32
        assert layer(torch.rand(1, layer.in_channels, 8, 8)).dtype == torch.bfloat16
    returns = network.get_submodule("association.point_head")
    assert isinstance(returns, Float32Linear)
    assert returns(torch.rand(1, 2, 128).bfloat16()).dtype == torch.float32


def test_a_layer_of_raw_values_rounds_nothing_before_its_result() -> None:
    layer = RawConv2d(1, 1, 1)
    with torch.no_grad():
        layer.weight.fill_(1.0)
        layer.bias.fill_(-1.0)
    x = torch.full((1, 1, 1, 1), 1.001)  # 1 in bfloat16, so that nothing would be left of it
    expected = (x - 1.0).bfloat16()
    assert torch.equal(convert(layer, torch.bfloat16)(x), expected)
    assert "rounded.values" not in layer.state_dict()
