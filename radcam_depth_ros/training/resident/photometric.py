"""Light and colour, as `training.data.photometric` and `training.data.unreadable` have them, for a batch on a device.

Images are (N, 3, H, W) float32, 0 to 1. Effects are drawn for each image; their strengths and shares are the same as on
the host, their random numbers are not.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from kornia.filters import gaussian_blur2d
from torch import Tensor
from torch.nn.functional import interpolate

from radcam_depth_ros.training.data.photometric import PhotometricConfig
from radcam_depth_ros.training.data.unreadable import FAINT, KINDS
from radcam_depth_ros.training.resident.chances import Chances

WIDEST_BLUR_PX = 2.0
"""Largest standard deviation of a blur; a wider one is that of a reduced image."""

_LUMA = (0.299, 0.587, 0.114)


def applied(images: Tensor, chosen: list[int], effect: Callable[[Tensor], Tensor]) -> Tensor:
    """The images, those that are chosen after an effect; in place."""
    if chosen:
        images[chosen] = effect(images[chosen])
    return images


def perceive(images: Tensor, config: PhotometricConfig, chances: Chances) -> Tensor:
    """Light and colour of a batch; changed in place."""
    count = len(images)

    def tone(part: Tensor) -> Tensor:
        gamma, contrast, brightness = (
            chances.uniform(-strength, strength, len(part), 1, 1, 1).exp()
            for strength in (config.gamma, config.contrast, config.brightness)
        )
        return ((part**gamma - 0.5) * contrast + 0.5) * brightness

    def colour(part: Tensor) -> Tensor:
        balance = chances.uniform(-config.white_balance, config.white_balance, len(part), 3, 1, 1).exp()
        return saturated(part * balance, chances.uniform(0.2, 1.6, len(part), 1, 1, 1))

    def illumination(part: Tensor) -> Tensor:
        rows, columns = chances.host.integers(2, 6, 2).tolist()
        field = chances.normal(len(part), 1, rows, columns) * config.illumination_strength
        return part * interpolate(field, part.shape[2:], mode="bicubic", align_corners=False).exp()

    def noise(part: Tensor) -> Tensor:
        return part + chances.uniform(0, config.noise_level, len(part), 1, 1, 1) * chances.normal(*part.shape)

    applied(images, chances.some(count, config.tone), tone)
    applied(images, chances.some(count, config.colour), colour)
    applied(images, chances.some(count, config.grey), lambda part: saturated(part, part.new_zeros(len(part), 1, 1, 1)))
    applied(images, chances.some(count, config.illumination), illumination)
    applied(images, chances.some(count, config.shadow), lambda part: part * _shadows(part, chances))
    blur_px = min(max(config.blur_px, 0.3), WIDEST_BLUR_PX)
    applied(
        images, chances.some(count, config.blur), lambda part: blurred(part, chances.uniform(0.3, blur_px, len(part)))
    )
    applied(images, chances.some(count, config.noise), noise)
    return images.clamp_(0, 1)


def saturated(images: Tensor, saturation: Tensor) -> Tensor:
    """Colours drawn towards their brightness, or away from it; `saturation` is (N, 1, 1, 1)."""
    luma = (images * images.new_tensor(_LUMA)[:, None, None]).sum(1, keepdim=True)
    return luma + saturation * (images - luma)


def blurred(images: Tensor, sigma_px: Tensor) -> Tensor:
    """A Gaussian blur of each image; `sigma_px` is (N,), at most `WIDEST_BLUR_PX`."""
    # As wide for all as the widest may be: asking the device for the largest would wait for it.
    reach = min(2 * math.ceil(4 * WIDEST_BLUR_PX) + 1, 2 * ((min(images.shape[2:]) - 1) // 2) + 1)
    result: Tensor = gaussian_blur2d(images, (reach, reach), sigma_px[:, None].expand(-1, 2), "reflect")
    return result


def _shadows(images: Tensor, chances: Chances) -> Tensor:
    """A factor for each pixel, (N, 1, H, W): up to three darkened polygons, each the inside of some lines."""
    count, _, height, width = images.shape
    rows = torch.arange(height, device=images.device)[:, None] / height
    columns = torch.arange(width, device=images.device)[None, :] / width
    light = images.new_ones(count, 1, height, width)
    for _ in range(int(chances.host.integers(1, 4))):
        sides = int(chances.host.integers(3, 7))
        angle = 2 * math.pi * (torch.arange(sides, device=images.device) + chances.uniform(0, 1, count, sides)) / sides
        centre, reach = chances.uniform(0, 1, count, 2, 1, 1), chances.normal(count, sides).abs() / 7 + 0.02
        x, y = (columns - centre[:, 0])[:, None], (rows - centre[:, 1])[:, None]
        outside = angle.cos()[..., None, None] * x + angle.sin()[..., None, None] * y - reach[..., None, None]
        softness = chances.uniform(0.003, 0.03, count, 1, 1)
        inside = torch.sigmoid(-outside.amax(1) / softness)
        light = light * (1 - inside * (1 - chances.uniform(0.3, 0.8, count, 1, 1)))[:, None]
    return light


def unreadable(images: Tensor, chosen: list[int], chances: Chances) -> list[bool]:
    """Replaces the chosen images, in place, by ones that tell little; whether each of all may tell anything."""
    readable = [True] * len(images)
    for index in chosen:
        kind = KINDS[int(chances.host.integers(len(KINDS)))]
        images[index] = _replaced(images[index], kind, chances).clamp(0, 1)
        readable[index] = kind in FAINT
    return readable


def _replaced(image: Tensor, kind: str, chances: Chances) -> Tensor:
    """(3, H, W) of a kind, see `training.data.unreadable`."""

    def between(low: float, high: float) -> float:
        return float(chances.host.uniform(low, high))

    if kind == "black":
        return torch.zeros_like(image)
    if kind == "even":
        return torch.full_like(image, between(0, 1))
    if kind == "noise":
        return 0.5 + between(0.05, 0.5) * chances.normal(*image.shape)
    if kind == "blurred":
        return _coarse(image, between(4.0, 20.0))
    if kind == "dark":
        return image * between(0.01, 0.15) + between(0.0, 0.02) * chances.normal(*image.shape)
    if kind == "gloomy":
        return image.clamp(1e-4, 1.0) ** between(2.5, 6.0) + 0.02 * chances.normal(*image.shape)
    if kind == "washed_out":
        return 1.0 - (1.0 - image) * between(0.05, 0.4)
    return image.flip(1)


def _coarse(image: Tensor, sigma_px: float) -> Tensor:
    """A strong Gaussian blur: of a reduced image, enlarged again."""
    _, height, width = image.shape
    share = min(1.0, WIDEST_BLUR_PX / sigma_px)
    small = interpolate(image[None], (max(3, round(share * height)), max(3, round(share * width))), mode="area")
    soft = blurred(small, image.new_full((1,), WIDEST_BLUR_PX))
    return interpolate(soft, (height, width), mode="bicubic", align_corners=False)[0]
