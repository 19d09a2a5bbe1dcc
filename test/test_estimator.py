from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from radcam_depth_ros.estimator import Computation, Estimator, EstimatorConfig, EstimatorError, radar_columns
from radcam_depth_ros.frame import CameraModel, Frame, GroundPlane, RadarReturns, RadcamDepthError
from radcam_depth_ros.geometry import CanonicalCamera, GeometryError
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io.archive import Archive, Card

FOCAL = 630.0
WALL_M = 2.0


class MeasuresAWall(nn.Module):
    """Depth of a white wall of known width, from its width in pixels: what a network would have to learn.

    In float32, as all networks make metres; the image comes in the engine's format.
    """

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        image = image.float()
        width_px = image.mean(dim=1).mean(dim=1).sum(dim=1) / image.mean(dim=1).mean(dim=1).amax(dim=1)
        dense = torch.ones_like(image[:, :1]) * 630.0 * 2.0 / width_px.reshape(-1, 1, 1, 1)
        return Depths(dense, torch.full_like(dense, float("nan")), torch.ones_like(dense))


class GivesTheRoad(nn.Module):
    """The flat road's depth, as far as it is known, and 50 m else."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        u = torch.arange(image.shape[3]).float().reshape(1, 1, 1, -1)
        v = torch.arange(image.shape[2]).float().reshape(1, 1, -1, 1)
        inverse = ground[:, 0] * u + ground[:, 1] * v + ground[:, 2]
        dense = (1.0 / inverse.clamp(min=0.02)).nan_to_num(50.0) * torch.ones_like(image[:, :1])
        return Depths(dense, dense, torch.ones_like(dense))


class GivesCoarseMaps(nn.Module):
    """Maps of a quarter of the size, NaN in semi-dense ones but for one value."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        dense = torch.full_like(image[:, :1, ::4, ::4], 7.0)
        semi_dense = torch.full_like(dense, float("nan"))
        semi_dense[:, :, 1, 2] = 5.0
        return Depths(dense, semi_dense, dense)


class GivesClasses(nn.Module):
    """A car in the image's upper left quarter, road elsewhere."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        dense = torch.full_like(image[:, :1], 7.0)
        classes = torch.zeros_like(dense, dtype=torch.uint8)
        classes[:, :, : image.shape[2] // 2, : image.shape[3] // 2] = 13
        return Depths(dense, dense, dense, classes)


class GivesNaN(nn.Module):
    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        dense = image[:, :1] * float("nan")
        return Depths(dense, dense, dense)


def estimator(network: nn.Module, config: EstimatorConfig | None = None) -> Estimator:
    return Estimator(config, Archive(network, Card("test", {}, FOCAL, 1.0, 100.0, "nothing")))


def frame(camera: CameraModel, image: np.ndarray, ground: GroundPlane | None = None) -> Frame:
    return Frame(7, "camera", image, camera, RadarReturns.empty(), ground or GroundPlane())


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@settings(max_examples=30, deadline=None)
@example(width=300, height=100, focal=850.0, ratio=1.0, share=0.125)
@given(
    st.integers(300, 2048),
    st.integers(100, 700),
    st.floats(300, 2500),
    st.floats(0.97, 1.03),
    st.floats(0.1, 0.9),
)
def test_a_flat_wall_has_the_same_depth_for_any_camera(
    precision: str, width: int, height: int, focal: float, ratio: float, share: float
) -> None:
    camera = CameraModel(width, height, focal, focal * ratio, width / 2, height / 2)
    try:
        plan = CanonicalCamera.plan(camera, FOCAL)
    except GeometryError:
        return
    if plan.scaled.width < 150:
        return  # whole pixels are too coarse to show half a percent
    wall_px = max(8, round(share * width))
    wall_px -= (wall_px - width) % 2
    depth_m = focal * WALL_M / wall_px
    wall = np.zeros(width)
    start = (width - wall_px) // 2
    wall[start : start + wall_px] = 255
    # Soft edges: where a sharp one lies within a pixel, no resampling can tell.
    wall = np.convolve(wall, np.full(7, 1 / 7), "same")
    image = np.broadcast_to(wall.round().astype(np.uint8)[None, :, None], (height, width, 3)).copy()
    result = estimator(MeasuresAWall(), EstimatorConfig(precision=precision)).estimate(frame(camera, image))
    assert result.dense.shape == (height, width)
    np.testing.assert_allclose(result.dense, depth_m, rtol=5e-3)


@pytest.mark.usefixtures("number_format")
@pytest.mark.parametrize(
    "camera", [CameraModel(800, 448, 630, 630, 400, 200), CameraModel(1600, 900, 1266, 1266, 810, 440)]
)
def test_the_road_reaches_the_network_and_its_depth_comes_back_in_place(camera: CameraModel) -> None:
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    result = estimator(GivesTheRoad()).estimate(frame(camera, image, GroundPlane(1.5)))
    rows = np.arange(camera.height - 40, camera.height - 5)
    expected = 1.5 * camera.fy / (rows - camera.cy)
    np.testing.assert_allclose(result.dense[rows, 10], expected, rtol=5e-3)
    np.testing.assert_allclose(result.semi_dense[rows, 10], expected, rtol=2e-2)


def test_an_unknown_road_is_nan_for_the_network() -> None:
    camera = CameraModel(64, 32, FOCAL, FOCAL, 32, 16)
    result = estimator(GivesTheRoad()).estimate(frame(camera, np.zeros((32, 64, 3), np.uint8)))
    assert (result.dense == 50).all()


def test_the_networks_own_size() -> None:
    camera = CameraModel(320, 180, 1260, 1260, 160, 90)
    image = np.zeros((180, 320, 3), np.uint8)
    result = estimator(GivesTheRoad(), EstimatorConfig(output_size="network")).estimate(frame(camera, image))
    assert result.dense.shape == (90, 160)
    assert result.camera.fx == pytest.approx(FOCAL)
    assert result.camera.width == 160


def test_radar_columns_leave_out_what_cannot_be_seen() -> None:
    camera = CameraModel(64, 32, 100, 100, 32, 16)
    points = [[0, 0, 10], [0, 0, -10], [0, 0, 0], [0, 0, 150], [100, 0, 10], [0.1, 0, 20]]
    columns = radar_columns(RadarReturns.from_points(points), camera, 100)
    np.testing.assert_allclose(columns[:, 2], [10, 20])
    np.testing.assert_allclose(columns[0, :3], [32, 16, 10])
    assert np.isnan(columns[:, 3:]).all()


@pytest.mark.usefixtures("number_format")
def test_maps_of_a_quarter_of_the_size() -> None:
    camera = CameraModel(64, 32, FOCAL, FOCAL, 32, 16)
    result = estimator(GivesCoarseMaps()).estimate(frame(camera, np.zeros((32, 64, 3), np.uint8)))
    assert (result.dense == 7).all()
    assert (result.semi_dense[4:8, 8:12] == 5).all()
    assert np.isfinite(result.semi_dense).sum() == 16  # NaN does not bleed, nor do values


def test_classes_come_at_the_cameras_size_and_are_never_blended() -> None:
    camera = CameraModel(128, 64, 2 * FOCAL, 2 * FOCAL, 64, 32)
    image = np.zeros((64, 128, 3), np.uint8)
    classes = estimator(GivesClasses()).estimate(frame(camera, image)).classes
    assert classes is not None
    expected = np.zeros((64, 128), np.uint8)
    expected[:32, :64] = 13
    np.testing.assert_array_equal(classes, expected, strict=True)
    assert estimator(GivesClasses()).estimate(frame(camera, image), classes=False).classes is None
    assert estimator(GivesTheRoad()).estimate(frame(camera, image)).classes is None


def test_a_network_that_gives_nonsense_is_refused() -> None:
    camera = CameraModel(64, 32, FOCAL, FOCAL, 32, 16)
    with pytest.raises(EstimatorError, match="not finite"):
        estimator(GivesNaN()).estimate(frame(camera, np.zeros((32, 64, 3), np.uint8)))


@pytest.mark.usefixtures("number_format")
def test_a_read_only_image_is_taken(small_weights: Path) -> None:
    camera = CameraModel(64, 32, FOCAL, FOCAL, 32, 16)
    image = np.zeros((32, 64, 3), np.uint8)
    image.flags.writeable = False
    loaded = Estimator(EstimatorConfig(model_file=str(small_weights)))
    loaded.warm_up(camera)
    assert np.isfinite(loaded.estimate(frame(camera, image)).dense).all()
    assert "baff" in loaded.describe()
    assert re.search(r" on cpu in (float32|bfloat16) \(.+\)$", loaded.describe())


def test_what_a_fleet_compares_is_told(small_weights: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADCAM_DEPTH_PRECISION", "bfloat16")
    loaded = Estimator(EstimatorConfig(model_file=str(small_weights), threads=1))
    sha256 = hashlib.sha256(small_weights.read_bytes()).hexdigest()
    assert loaded.computation == Computation("bfloat16", 1, sha256)
    assert [value for _, value in loaded.computation.values()] == ["bfloat16", "1", sha256]
    assert "of no file" in dict(estimator(GivesTheRoad()).computation.values())["SHA-256 of the weight file"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"device": "warp"}, "device 'warp' cannot be used"),
        ({"output_size": "huge"}, "output_size must be one of native, network, got 'huge'"),
        ({"precision": "half"}, "precision must be one of auto, float32, bfloat16, got 'half'"),
        ({"threads": -1}, "threads must be"),
    ],
)
def test_settings_that_cannot_be(values: dict[str, object], message: str) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        estimator(GivesTheRoad(), EstimatorConfig(**values))


@pytest.mark.parametrize("entry", ["", "abc", "g" * 64])
def test_a_trusted_model_is_named_by_its_sha256(entry: str) -> None:
    with pytest.raises(EstimatorError, match="64 hexadecimal digits"):
        EstimatorConfig(trusted_models=(entry,))
