"""Effects on light and appearance on a device, beside those on the host."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_training import RECIPE
from torch import Tensor

from radcam_depth_ros.training.data import appearance as on_host
from radcam_depth_ros.training.data import photometric as light_on_host
from radcam_depth_ros.training.data.appearance import AppearanceConfig
from radcam_depth_ros.training.data.photometric import PhotometricConfig
from radcam_depth_ros.training.data.unreadable import KINDS
from radcam_depth_ros.training.resident.appearance import develop, restyle
from radcam_depth_ros.training.resident.chances import Chances
from radcam_depth_ros.training.resident.photometric import perceive, unreadable

CPU = torch.device("cpu")
SHAPE = (96, 128)
LIGHT = ("tone", "colour", "grey", "illumination", "shadow", "blur", "noise")
SURFACES = ("recolour", "texture", "sky", "haze")
PROCESSING = ("tone_curve", "channel_mixing", "spectrum", "equalise", "sharpen", "jpeg")
DRAWS = 64


def picture() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Smooth colours with edges and some noise."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    smooth = np.stack([rows + 60, columns + 30, 200 - rows // 2 - columns // 2], axis=-1)
    smooth[40:70, 30:80] //= 2
    return (smooth + rng.integers(0, 12, (*SHAPE, 3))).astype(np.uint8)


CLASSES = np.repeat(np.array([0, 2, 10, 255], np.uint8), SHAPE[1] // 4)[None, :].repeat(SHAPE[0], 0)
DEPTH = np.linspace(80, 5, SHAPE[0], dtype=np.float16)[:, None].repeat(SHAPE[1], 1)
DEPTH[:24] = np.inf


def pictures(count: int = DRAWS) -> Tensor:
    return torch.from_numpy(picture()).permute(2, 0, 1)[None].float().div(255).repeat(count, 1, 1, 1)


def configs(effect: str) -> tuple[PhotometricConfig, AppearanceConfig]:
    """With one effect alone, which happens to each picture."""
    light, looks = RECIPE.augmentation.photometric, RECIPE.augmentation.appearance
    light = replace(light, **dict.fromkeys(LIGHT, 0.0))
    looks = replace(looks, **dict.fromkeys((*SURFACES, *PROCESSING), 0.0))
    if effect in LIGHT:
        return replace(light, **{effect: 1.0}), looks
    return light, replace(looks, **{effect: 1.0})


def on_device(effect: str, seed: int = 0) -> Tensor:
    light, looks = configs(effect)
    chances = Chances((seed,), CPU)
    depth_m = torch.from_numpy(DEPTH).float().repeat(DRAWS, 1, 1)
    classes = torch.from_numpy(CLASSES).repeat(DRAWS, 1, 1)
    images = restyle(pictures(), depth_m, classes, looks, chances)
    return develop(perceive(images, light, chances), looks, chances)


def by_numpy(effect: str) -> Tensor:
    light, looks = configs(effect)
    images = []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        image = light_on_host.perceive(on_host.restyle(picture(), DEPTH, CLASSES, looks, rng), light, rng)
        images.append(torch.from_numpy(on_host.develop(image, looks, rng)).permute(2, 0, 1))
    return torch.stack(images)


@pytest.mark.parametrize("effect", [*LIGHT, *SURFACES, *PROCESSING])
def test_an_effect_is_as_strong_as_on_the_host(effect: str) -> None:
    mine, theirs = on_device(effect), by_numpy(effect)
    assert mine.dtype == torch.float32
    assert mine.shape == theirs.shape
    assert 0 <= mine.min() < mine.max() <= 1
    changes = [(images - pictures()).abs().mean((1, 2, 3)) for images in (mine, theirs)]
    for share in (0.5, 0.75):
        ratio = float(changes[0].quantile(share) / changes[1].quantile(share))
        assert 0.55 < ratio < 1.8, f"at {share} of the pictures a change is {ratio:.2f} times the host's"
    means = [float(images.mean()) for images in (mine, theirs)]
    assert means[0] == pytest.approx(means[1], abs=0.08)


@pytest.mark.parametrize("effect", [*LIGHT, *SURFACES, *PROCESSING])
def test_the_same_seed_gives_the_same_pictures_and_each_is_another(effect: str) -> None:
    first = on_device(effect, 5)
    assert torch.equal(first, on_device(effect, 5))
    if effect != "grey":
        assert not torch.equal(first[0], first[1])
        assert not torch.equal(first, on_device(effect, 6))


def test_what_has_no_class_keeps_its_look() -> None:
    for effect in ("recolour", "texture"):
        changed = on_device(effect) != pictures()
        assert not changed[..., CLASSES[0] == 255].any()
        assert changed[..., CLASSES[0] != 255].any()


def test_a_picture_without_sky_keeps_its_look_and_one_of_unknown_depth_has_no_haze() -> None:
    near, unknown = torch.full((4, *SHAPE), 20.0), torch.full((4, *SHAPE), torch.nan)
    classes = torch.from_numpy(CLASSES).repeat(4, 1, 1)
    for effect, depth_m in (("sky", near), ("haze", unknown)):
        _, looks = configs(effect)
        assert torch.equal(restyle(pictures(4), depth_m, classes, looks, Chances((0,), CPU)), pictures(4))


def test_a_picture_is_told_little_by_each_kind() -> None:
    images = pictures(64)
    readable = unreadable(images, list(range(1, 64)), Chances((0,), CPU))
    assert torch.equal(images[0], pictures(1)[0])
    assert readable[0]
    assert 0 < readable.count(False) < 63
    assert 0 <= images.min() < images.max() <= 1
    assert (images[1:] != pictures(63)).flatten(1).any(1).all()
    assert len({round(float(image.std()), 3) for image in images}) > len(KINDS)


def test_some_are_chosen_as_often_as_asked() -> None:
    chances = Chances((0,), CPU)
    assert chances.some(10, 0.0) == []
    assert chances.some(3, 1.0) == [0, 1, 2]
    assert 200 < len(chances.some(1000, 0.25)) < 300
