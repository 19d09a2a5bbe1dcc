from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_training import RECIPE

from radcam_depth_ros.frame import CameraModel, GroundPlane
from radcam_depth_ros.geometry import ground_coefficients, project
from radcam_depth_ros.training.data.augmentation import augment, perturb_ground, perturb_radar
from radcam_depth_ros.training.data.photometric import PhotometricConfig, perceive
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.data.unreadable import unreadable
from radcam_depth_ros.training.data.views import crop, mirrored, zoom

CAMERA = CameraModel(160, 96, 120.0, 118.0, 83.0, 41.0)
UP = np.array([0.05, -0.99, 0.08]) / np.linalg.norm([0.05, -0.99, 0.08])
GROUND = GroundPlane(1.5, (float(UP[0]), float(UP[1]), float(UP[2])))
UNCHANGED = replace(RECIPE.augmentation,
    mirror=0.0,
    photometric=replace(
        RECIPE.augmentation.photometric, tone=0, colour=0, grey=0, illumination=0, shadow=0, blur=0, noise=0
    ),
    radar=replace(RECIPE.augmentation.radar,
        none=0, one_radar=0, thinned=0, clutter=0, pixel_noise=0, depth_noise_m=0, rcs_unknown=0, speed_unknown=0,
        age_unknown=0,
    ),
    ground=replace(RECIPE.augmentation.ground, unknown=0, height_share=0, pitch_deg=0, roll_deg=0),
)  # fmt: skip


def make_sample(points: int = 5, radars: int = 1) -> TrainingSample:
    rng = np.random.default_rng(0)
    xyz = rng.uniform([-2, -1, 6], [2, 1, 30], (points, 3)).astype(np.float32)
    uv, depth = project(xyz, CAMERA)
    image = rng.integers(0, 256, (96, 160, 3), dtype=np.uint8)
    return TrainingSample(
        image=image,
        depth_m=(image[..., 0] / 4 + 1).astype(np.float16),
        classes=image[..., 1],
        radar=np.column_stack([uv, depth, depth * 0 + 5, depth * 0, depth * 0]).astype(np.float32),
        radar_source=(np.arange(points) % max(radars, 1)).astype(np.uint8),
        camera=CAMERA,
        ground=GROUND,
    )


def points_of(sample: TrainingSample) -> np.ndarray:
    """The returns' places in space, from their pixels and depths."""
    camera, radar = sample.camera, sample.radar
    x = (radar[:, 0] - camera.cx) / camera.fx * radar[:, 2]
    y = (radar[:, 1] - camera.cy) / camera.fy * radar[:, 2]
    return np.column_stack([x, y, radar[:, 2]])


@settings(max_examples=30, deadline=None)
@given(top=st.integers(0, 32), left=st.integers(0, 64))
def test_a_crop_leaves_points_and_road_where_they_are_in_space(top: int, left: int) -> None:
    sample = make_sample()
    cut = crop(sample, top, left, 64, 96)
    np.testing.assert_array_equal(cut.image, sample.image[top : top + 64, left : left + 96])
    np.testing.assert_array_equal(cut.depth_m, sample.depth_m[top : top + 64, left : left + 96])
    np.testing.assert_allclose(points_of(cut), points_of(sample), rtol=1e-4, atol=1e-4)
    before = ground_coefficients(sample.ground, sample.camera)[:3].astype(float)
    after = ground_coefficients(cut.ground, cut.camera)[:3].astype(float)
    u, v = 7.0, 60.0
    assert after @ [u, v, 1] == pytest.approx(before @ [u + left, v + top, 1], abs=1e-5)


@settings(max_examples=30, deadline=None)
@given(height=st.integers(70, 130), width=st.integers(120, 210))
def test_zooming_leaves_points_and_road_where_they_are_in_space(height: int, width: int) -> None:
    sample = make_sample()
    zoomed = zoom(sample, (height, width))
    assert zoomed.image.shape == (height, width, 3)
    assert zoomed.depth_m.shape == zoomed.classes.shape == (height, width)
    np.testing.assert_allclose(points_of(zoomed), points_of(sample), rtol=1e-4, atol=1e-4)
    # Depths are never blended, and each pixel's is that of the direction it looks into.
    row, column = height // 3, width // 4
    u = (column - zoomed.camera.cx) / zoomed.camera.fx * CAMERA.fx + CAMERA.cx
    v = (row - zoomed.camera.cy) / zoomed.camera.fy * CAMERA.fy + CAMERA.cy
    nearest = {sample.depth_m[int(v + a), int(u + b)].item() for a in (0.499, 0.501) for b in (0.499, 0.501)}
    assert zoomed.depth_m[row, column].item() in nearest
    before = ground_coefficients(sample.ground, sample.camera)[:3].astype(float)
    after = ground_coefficients(zoomed.ground, zoomed.camera)[:3].astype(float)
    assert after @ [column, row, 1] == pytest.approx(before @ [u, v, 1], abs=1e-5)


def test_the_focal_length_varies_within_its_bound() -> None:
    config = replace(UNCHANGED, focal_jitter=0.15)
    results = [augment(make_sample(), (64, 96), config, np.random.default_rng(seed)) for seed in range(40)]
    assert {image.shape for _, image in results} == {(64, 96, 3)}
    changes = np.log([sample.camera.fx / CAMERA.fx for sample, _ in results])
    assert changes.min() < -0.08
    assert changes.max() > 0.08
    assert np.abs(changes).max() < 0.17
    # A crop of the whole image can only be zoomed into: there is nothing beyond.
    whole, _ = augment(make_sample(), (96, 160), config, np.random.default_rng(2))
    assert whole.camera.fx >= CAMERA.fx
    assert np.isfinite(whole.depth_m).all()


def test_a_mirrored_point_is_the_point_with_x_negated() -> None:
    sample = make_sample()
    flipped = mirrored(sample)
    np.testing.assert_allclose(points_of(flipped), points_of(sample) * [-1, 1, 1], rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(flipped.image, sample.image[:, ::-1])
    np.testing.assert_array_equal(flipped.depth_m, sample.depth_m[:, ::-1])
    np.testing.assert_array_equal(flipped.classes, sample.classes[:, ::-1])
    before = ground_coefficients(sample.ground, sample.camera)[:3].astype(float)
    after = ground_coefficients(flipped.ground, flipped.camera)[:3].astype(float)
    assert after @ [20, 80, 1] == pytest.approx(before @ [159 - 20, 80, 1], abs=1e-6)


def test_mirroring_twice_changes_nothing() -> None:
    sample = make_sample()
    twice = mirrored(mirrored(sample))
    np.testing.assert_array_equal(twice.image, sample.image)
    np.testing.assert_allclose(twice.radar, sample.radar, rtol=1e-5)
    assert twice.camera == sample.camera
    assert twice.ground == sample.ground


def test_a_crop_larger_than_the_image_knows_nothing_beyond_it() -> None:
    cut = crop(make_sample(), 0, 0, 128, 192)
    assert cut.image.shape == (128, 192, 3)
    assert not cut.image[96:].any()
    assert np.isnan(cut.depth_m[:, 160:]).all()
    assert (cut.classes[96:] == 255).all()


def test_returns_whose_region_does_not_reach_the_crop_are_left_out() -> None:
    sample = make_sample(2)
    radar = sample.radar.copy()
    radar[:, 0] = [2.0, 150.0]
    assert len(crop(replace(sample, radar=radar), 0, 96, 64, 64).radar) == 1


def test_without_any_effect_a_sample_stays_as_it_is() -> None:
    sample = make_sample()
    result, image = augment(sample, (96, 160), UNCHANGED, np.random.default_rng(0))
    np.testing.assert_allclose(image * 255, sample.image, atol=1e-3)
    # Returns come in another order.
    np.testing.assert_array_equal(np.sort(result.radar, axis=0), np.sort(sample.radar, axis=0))
    assert result.ground.up == pytest.approx(sample.ground.up)


def test_the_same_generator_gives_the_same_sample() -> None:
    results = [augment(make_sample(), (64, 96), RECIPE.augmentation, np.random.default_rng(7)) for _ in range(2)]
    np.testing.assert_array_equal(results[0][1], results[1][1])
    np.testing.assert_array_equal(results[0][0].radar, results[1][0].radar)
    assert results[0][0].ground == results[1][0].ground or not results[0][0].ground.is_known


@pytest.mark.parametrize("seed", range(20))
def test_every_augmented_sample_is_fit_for_a_network(seed: int) -> None:
    config = replace(
        RECIPE.augmentation, radar=replace(RECIPE.augmentation.radar, min_points=5, max_points=10, clutter=1.0)
    )
    sample, image = augment(make_sample(30, radars=2), (64, 96), config, np.random.default_rng(seed))
    assert image.shape == (64, 96, 3)
    assert image.dtype == np.float32
    assert 0 <= image.min() <= image.max() <= 1
    assert len(sample.radar) <= 10
    assert sample.radar.dtype == np.float32
    assert len(sample.radar) == len(sample.radar_source)
    assert np.isfinite(sample.radar[:, :3]).all()
    assert (sample.radar[:, 2] > 0).all()


def test_radars_are_left_out_alone_or_altogether() -> None:
    sample = make_sample(40, radars=2)
    config = replace(UNCHANGED.radar, none=0.2, one_radar=0.5)
    rng = np.random.default_rng(0)
    seen = {tuple(np.unique(perturb_radar(sample, config, rng)[1])) for _ in range(60)}
    assert seen == {(), (0,), (1,), (0, 1)}


def test_a_sample_without_returns_can_get_clutter() -> None:
    radar, source = perturb_radar(make_sample(0), replace(UNCHANGED.radar, clutter=1.0), np.random.default_rng(0))
    assert 1 <= len(radar) == len(source) <= 3
    assert np.isnan(radar[:, 3:]).all()


def test_a_radar_without_elevation_scatters_returns_along_their_columns_alone() -> None:
    sample = make_sample(200)
    config = replace(UNCHANGED.radar, elevation_noise=1.0, elevation_noise_deg=6.0, min_points=200, max_points=200)
    deviations_px = []
    for seed in range(20):
        radar, _ = perturb_radar(sample, config, np.random.default_rng(seed))
        found = {(float(row[0]), float(row[2])): float(row[1]) for row in radar}
        deviations_px.append(np.std([found[float(row[0]), float(row[2])] - row[1] for row in sample.radar]))
    limit_px = CAMERA.fy * np.tan(np.deg2rad(6.0))
    assert max(deviations_px) < 1.2 * limit_px
    assert 0.3 * limit_px < np.mean(deviations_px) < 0.7 * limit_px


def test_ground_errors_stay_within_their_limits() -> None:
    config = replace(RECIPE.augmentation.ground, unknown=0.3, height_share=0.1, pitch_deg=1.0, roll_deg=0.5)
    rng = np.random.default_rng(0)
    results = [perturb_ground(GROUND, config, rng) for _ in range(200)]
    known = [ground for ground in results if ground.is_known]
    assert 100 < len(known) < 180
    angles = [np.degrees(np.arccos(min(1.0, float(np.dot(ground.up, UP))))) for ground in known]
    assert 0.5 < max(angles) < 1.2
    assert all(abs(ground.height_m / 1.5 - 1) <= 0.1 for ground in known)
    assert not perturb_ground(GroundPlane(), config, rng).is_known


def test_light_changes_the_image_but_not_its_size() -> None:
    image = np.full((64, 96, 3), 128, np.uint8)
    config = PhotometricConfig(1, 0.5, 0.4, 0.3, 1, 0.2, 1, 1, 0.35, 1, 1, 1.5, 1, 0.03)
    result = perceive(image, config, np.random.default_rng(1))
    assert result.shape == image.shape
    assert result.std() > 0.01


@pytest.mark.parametrize("seed", range(16))
def test_an_unreadable_picture_is_still_a_picture(seed: int) -> None:
    image = np.random.default_rng(0).random((32, 48, 3), np.float32)
    result, may_tell = unreadable(image, np.random.default_rng(seed))
    assert may_tell in (True, False)
    assert (result.shape, result.dtype) == (image.shape, np.float32)
    assert ((result >= 0) & (result <= 1)).all()
    assert (result != image).any()
