from __future__ import annotations

import array

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.frame import CameraModel, FrameError, Lens
from radcam_depth_ros.geometry import CanonicalCamera
from radcam_depth_ros.resampling import enlarge_nearest, enlarge_smooth, rectify, resample_image, spread_nearest

FOCAL = 630.0
NUSCENES = CameraModel(1600, 900, 1266.0, 1266.0, 816.0, 491.5)
DISTORTED = Lens(tuple(NUSCENES.matrix.reshape(-1)), model="plumb_bob", distortion=(-0.3, 0.1, 0.001, 0.001, 0.0))


def smooth_image(camera: CameraModel, cells: int = 24) -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 256, (cells, 2 * cells, 3), np.uint8)
    return cv2.resize(noise, (camera.width, camera.height), interpolation=cv2.INTER_CUBIC)


def test_an_image_that_needs_no_scaling_is_only_padded() -> None:
    plan = CanonicalCamera.plan(CameraModel(40, 33, FOCAL, FOCAL, 20, 16), FOCAL)
    image = np.random.default_rng(0).integers(0, 255, (33, 40, 3), np.uint8)
    resampled = resample_image(image, plan)
    assert resampled.shape == (64, 64, 3)
    np.testing.assert_array_equal(resampled[:33, :40], image)
    np.testing.assert_array_equal(resampled[60, :40], image[32])
    np.testing.assert_array_equal(resampled[:33, 60], image[:, 39])


@pytest.mark.parametrize("lens", [None, DISTORTED], ids=["ideal", "distorted"])
@pytest.mark.parametrize("focal_px", [1266.0, 844.0, 630.0, 400.0, 1900.0])
def test_one_remap_is_as_good_as_rectifying_and_shrinking(lens: Lens | None, focal_px: float) -> None:
    plan = CanonicalCamera.plan(NUSCENES, focal_px)
    image = smooth_image(NUSCENES)
    resampled = resample_image(image, plan, lens)
    assert resampled.shape == (plan.network.height, plan.network.width, 3)
    assert resampled.flags.c_contiguous
    size = (plan.scaled.width, plan.scaled.height)
    interpolation = cv2.INTER_AREA if focal_px < 1266 else cv2.INTER_LINEAR
    expected = cv2.resize(rectify(image, NUSCENES, lens), size, interpolation=interpolation)
    difference = np.abs(resampled[: size[1], : size[0]].astype(int) - expected)
    assert difference.mean() < 0.6
    assert np.percentile(difference, 99.9) <= 6


@pytest.mark.parametrize("focal_px", [1266.0, 630.0, 400.0, 1900.0])
def test_an_ideal_lens_gives_the_same_as_none(focal_px: float) -> None:
    plan = CanonicalCamera.plan(NUSCENES, focal_px)
    image = smooth_image(NUSCENES)
    ideal = resample_image(image, plan, Lens(tuple(NUSCENES.matrix.reshape(-1))))
    assert np.abs(resample_image(image, plan).astype(int) - ideal).max() <= 2


def test_fine_stripes_become_grey_and_no_pattern() -> None:
    image = np.zeros((900, 1600, 3), np.uint8)
    image[:, ::2] = 255
    resampled = resample_image(image, CanonicalCamera.plan(NUSCENES, FOCAL), DISTORTED)
    # In the middle of the image, where the lens hardly stretches; a plain remap gives 0 to 255.
    assert np.ptp(resampled[150:300, 200:600].astype(int)) <= 2


def test_images_whose_rows_are_padded_and_sizes_that_do_not_divide() -> None:
    camera = CameraModel(1601, 903, 1900.0, 1900.0, 800.0, 450.0)
    image = smooth_image(camera)
    wide = np.zeros((903, 1700, 3), np.uint8)
    wide[:, :1601] = image
    plan = CanonicalCamera.plan(camera, FOCAL)
    np.testing.assert_array_equal(resample_image(wide[:, :1601], plan), resample_image(image, plan))
    expected = cv2.resize(image, (plan.scaled.width, plan.scaled.height), interpolation=cv2.INTER_AREA)
    resampled = resample_image(image, plan)[: plan.scaled.height, : plan.scaled.width]
    assert np.abs(resampled.astype(int) - expected).mean() < 1


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_maps_come_back_in_place(factor: int) -> None:
    plan = CanonicalCamera.plan(NUSCENES, FOCAL)
    # The column's own place, in pixels of the camera: (u + 1/2) scales.
    places = (np.arange(plan.network.width // factor) + 0.5) * factor * 1600 / plan.scaled.width - 0.5
    values = np.tile(places.astype(np.float32), (plan.network.height // factor, 1))
    columns = np.arange(40, 1560)
    smooth = enlarge_smooth(values, plan, NUSCENES)
    nearest = enlarge_nearest(values, plan, NUSCENES)
    assert smooth.shape == nearest.shape == (900, 1600)
    np.testing.assert_allclose(smooth[:, columns], np.tile(columns, (900, 1)), atol=0.02)
    assert np.abs(nearest[:, columns] - columns).max() <= factor * 1.01 + 0.01


def test_what_comes_back_lies_in_memory_that_a_message_takes() -> None:
    plan = CanonicalCamera.plan(NUSCENES, FOCAL)
    owner = enlarge_smooth(np.ones((448, 800), np.float32), plan, NUSCENES)
    while isinstance(owner, np.ndarray):
        owner = owner.base
    assert isinstance(owner.obj, array.array)


def test_a_lens_with_too_few_numbers_is_refused() -> None:
    with pytest.raises(FrameError, match="9 numbers of K and 9 of R, got 4 and 9"):
        Lens((1.0, 0.0, 0.0, 1.0))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 40))
def test_values_spread_to_the_nearest_pixels(seed, count):
    generator = np.random.default_rng(seed)
    values = np.full((40, 60), np.nan, np.float32)
    rows, columns = generator.integers(0, 40, count), generator.integers(0, 60, count)
    values[rows, columns] = generator.uniform(1, 80, count).astype(np.float32)
    spread, distance = spread_nearest(values)
    known = np.isfinite(values)
    np.testing.assert_array_equal(spread[known], values[known])
    v, u = np.mgrid[:40, :60]
    seeds = np.argwhere(known)
    exact = np.hypot(v[..., None] - seeds[:, 0], u[..., None] - seeds[:, 1])
    np.testing.assert_allclose(distance, exact.min(axis=2), rtol=0.03, atol=1e-3)
    # What a pixel was given lies no farther than the nearest value, within the transform's accuracy.
    given_by = np.where(values[seeds[:, 0], seeds[:, 1]] == spread[..., None], exact, np.inf).min(axis=2)
    assert (given_by <= exact.min(axis=2) * 1.06 + 1e-3).all()


def test_nothing_spreads_from_nothing():
    spread, distance = spread_nearest(np.full((4, 5), np.nan, np.float32))
    assert np.isnan(spread).all()
    assert np.isinf(distance).all()
