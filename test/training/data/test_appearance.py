from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_training import RECIPE

from radcam_depth_ros.frame import CameraModel, GroundPlane, ImageArray
from radcam_depth_ros.training.data.appearance import develop, restyle
from radcam_depth_ros.training.data.augmentation import augment
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.errors import TrainingError

SURFACES = ("recolour", "texture", "sky", "haze")
PROCESSING = ("tone_curve", "channel_mixing", "spectrum", "equalise", "sharpen", "jpeg")
ALL = replace(RECIPE.augmentation.appearance, **dict.fromkeys((*SURFACES, *PROCESSING), 1.0))
SHAPE = (64, 96)


def picture() -> ImageArray:
    """Smooth colours with some noise, as pictures have them."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    smooth = np.stack([rows * 2 + 40, columns * 2, 200 - rows - columns], axis=-1)
    return (smooth + rng.integers(0, 20, (*SHAPE, 3))).astype(np.uint8)


CLASSES = np.repeat(np.array([0, 2, 10, 255], np.uint8), SHAPE[1] // 4)[None, :].repeat(SHAPE[0], 0)
DEPTH = np.full(SHAPE, 20, np.float16)
DEPTH[:16] = np.inf


@pytest.mark.parametrize("effect", SURFACES)
def test_surfaces_look_different(effect: str) -> None:
    config = replace(RECIPE.augmentation.appearance, **{effect: 1.0})
    results = [restyle(picture(), DEPTH, CLASSES, config, np.random.default_rng(seed)) for seed in range(8)]
    assert {(image.shape, image.dtype) for image in results} == {((*SHAPE, 3), np.dtype(np.uint8))}
    assert sum(bool((image != picture()).mean() > 0.1) for image in results) >= 5


@pytest.mark.parametrize("effect", PROCESSING)
@pytest.mark.parametrize("seed", range(4))
def test_a_developed_picture_is_another_of_the_same_range(effect: str, seed: int) -> None:
    image = picture().astype(np.float32) / np.float32(255)
    result = develop(
        image.copy(), replace(RECIPE.augmentation.appearance, **{effect: 1.0}), np.random.default_rng(seed)
    )
    assert result.shape == image.shape
    assert result.dtype == np.float32
    assert 0 <= result.min() < result.max() <= 1
    assert not np.array_equal(result, image)
    # What was where is still there.
    grey, was = result.mean(axis=-1).ravel(), image.mean(axis=-1).ravel()
    assert np.corrcoef(grey, was)[0, 1] > 0.4


@pytest.mark.parametrize("effect", ["recolour", "texture"])
def test_what_has_no_class_keeps_its_look(effect: str) -> None:
    config = replace(replace(RECIPE.augmentation.appearance, recolour_share=1.0), **{effect: 1.0})
    result = restyle(picture(), DEPTH, CLASSES, config, np.random.default_rng(1))
    unknown = CLASSES == 255
    np.testing.assert_array_equal(result[unknown], picture()[unknown])
    assert (result[~unknown] != picture()[~unknown]).any()


def test_another_sky_changes_the_sky_alone() -> None:
    far = np.vstack([np.full((1, SHAPE[1]), True), np.isinf(DEPTH)[:-1]])  # and the row whose pixels are a part of it
    skies = []
    for seed in range(12):
        result = restyle(
            picture(), DEPTH, CLASSES, replace(RECIPE.augmentation.appearance, sky=1.0), np.random.default_rng(seed)
        )
        np.testing.assert_array_equal(result[~far], picture()[~far])
        skies.append(result[:12].mean())
    assert max(skies) - min(skies) > 80


def test_another_sky_needs_one() -> None:
    depth = np.full(SHAPE, 20, np.float16)
    result = restyle(
        picture(), depth, CLASSES, replace(RECIPE.augmentation.appearance, sky=1.0), np.random.default_rng(0)
    )
    np.testing.assert_array_equal(result, picture())


def test_haze_hides_what_is_far() -> None:
    depth = np.full(SHAPE, 5, np.float16)
    depth[:, 48:] = 80
    depth[:8] = np.inf
    depth[60, 3] = np.nan
    result = restyle(
        picture(), depth, CLASSES, replace(RECIPE.augmentation.appearance, haze=1.0), np.random.default_rng(0)
    )
    contrast = [part.std(axis=(0, 1)).mean() for part in (result[:8], result[8:, 48:], result[8:, :48])]
    assert contrast[0] < 0.5
    assert contrast[1] < contrast[2]


def test_haze_needs_depths() -> None:
    sparse = np.full(SHAPE, np.nan, np.float16)
    sparse[::8, ::8] = 20
    result = restyle(
        picture(), sparse, CLASSES, replace(RECIPE.augmentation.appearance, haze=1.0), np.random.default_rng(0)
    )
    np.testing.assert_array_equal(result, picture())


def test_an_effect_changes_nothing_else_of_a_sample() -> None:
    sample = TrainingSample(
        image=picture(),
        depth_m=DEPTH,
        classes=CLASSES,
        radar=np.array([[40, 30, 20, 5, 0, 0]] * 9, np.float32),
        radar_source=np.zeros(9, np.uint8),
        camera=CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5),
        ground=GroundPlane(1.5),
    )
    plain = RECIPE.augmentation
    (first, image), (second, other) = (
        augment(sample, (32, 64), config, np.random.default_rng(3))
        for config in (plain, replace(plain, appearance=ALL))
    )
    np.testing.assert_array_equal(first.radar, second.radar)
    np.testing.assert_array_equal(first.depth_m, second.depth_m)
    assert first.camera == second.camera
    assert not np.array_equal(image, other)


def test_wrong_strengths_are_refused() -> None:
    with pytest.raises(TrainingError, match=r"appearance\.haze must be between 0 and 1, got 2"):
        replace(RECIPE.augmentation.appearance, haze=2.0)
    with pytest.raises(TrainingError, match="jpeg_quality of 1 to 90"):
        replace(RECIPE.augmentation.appearance, jpeg_quality=99)
