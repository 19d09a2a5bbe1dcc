"""Surfaces, sky, air and the camera's processing, as `training.data.appearance` has them, for a batch on a device.

Images are (N, 3, H, W) float32, 0 to 1; depth (N, H, W) float32 metres; classes (N, H, W) uint8. Effects are drawn for
each image; their strengths and shares are the same as on the host, their random numbers are not.
"""

from __future__ import annotations

import torch
from kornia.color import rgb_to_ycbcr, ycbcr_to_rgb
from kornia.enhance import equalize_clahe, jpeg_codec_differentiable
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate

from radcam_depth_ros.training.data.appearance import HAZE_NEEDS, LEAST_SKY, SPECTRUM_SIDE, AppearanceConfig
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.resident.chances import Chances
from radcam_depth_ros.training.resident.photometric import applied, blurred

CLASSES = 256


def restyle(images: Tensor, depth_m: Tensor, classes: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    """Other surfaces and air: what is in front of the lens; changed in place."""
    count = len(images)
    chosen = chances.some(count, config.recolour)
    applied(images, chosen, lambda part: _recolour(part, classes[chosen].long(), config, chances))
    textured = chances.some(count, config.texture)
    applied(images, textured, lambda part: _texture(part, classes[textured].long(), config, chances))
    skies = chances.some(count, config.sky)
    applied(images, skies, lambda part: _sky(part, depth_m[skies], classes[skies].long(), chances))
    hazy = chances.some(count, config.haze)
    applied(images, hazy, lambda part: _haze(part, depth_m[hazy], config, chances))
    return images


def develop(images: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    """What cameras do to a picture; changed in place."""
    count = len(images)
    applied(images, chances.some(count, config.tone_curve), lambda part: _tone_curve(part, chances))
    applied(images, chances.some(count, config.channel_mixing), lambda part: _channel_mixing(part, chances))
    applied(images, chances.some(count, config.spectrum), lambda part: _spectrum(part, config, chances))
    applied(images, chances.some(count, config.sharpen), lambda part: _sharpen(part, chances))
    images.clamp_(0, 1)
    applied(images, chances.some(count, config.equalise), lambda part: _equalise(part, chances))
    applied(images, chances.some(count, config.jpeg), lambda part: _compress(part, config, chances))
    return images.clamp_(0, 1)


def _chosen(count: int, share: float, chances: Chances) -> Tensor:
    """(N, 256) which classes get an effect, 1 or 0: never the unknown one, which holds unlike things."""
    chosen = (chances.uniform(0, 1, count, CLASSES) < share).float()
    chosen[:, UNKNOWN_CLASS] = 0
    return chosen


def _of_classes(values: Tensor, classes: Tensor) -> Tensor:
    """(N, C, H, W) of (N, 256, C) values of each class."""
    picked = torch.stack([table[places] for table, places in zip(values, classes, strict=True)])
    return picked.permute(0, 3, 1, 2)


def _recolour(images: Tensor, classes: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    count = len(images)
    strength = _chosen(count, config.recolour_share, chances)[..., None]
    strength = strength * chances.uniform(0, config.recolour_strength, count, CLASSES, 1)
    colour = chances.uniform(20, 235, count, CLASSES, 1) + 25 * chances.normal(count, CLASSES, 3)
    contrast = chances.uniform(0.3, 1.3, count, CLASSES, 1)
    slope = (1 - strength) + strength * contrast
    offset = strength * (colour - 128 * contrast) / 255
    return (images * _of_classes(slope.expand(-1, -1, 3), classes) + _of_classes(offset, classes)).clamp(0, 1)


def _texture(images: Tensor, classes: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    count, _, height, width = images.shape
    field = images.new_zeros(count, 1, height, width)
    for cell in 2 ** chances.host.uniform(1, 6, 2):
        noise = chances.normal(count, 1, int(height / cell) + 2, int(width / cell) + 2)
        field += interpolate(noise, (height, width), mode="bilinear", align_corners=False)
    strength = _chosen(count, config.recolour_share, chances) * chances.uniform(-1, 1, count, CLASSES)
    strength = strength * config.texture_strength
    return (images * (field * _of_classes(strength[..., None], classes)).exp()).clamp(0, 1)


def _sky(images: Tensor, depth_m: Tensor, classes: Tensor, chances: Chances) -> Tensor:
    count, _, height, width = images.shape
    sky = torch.isinf(depth_m)
    # The mean of one of the classes that are there: sums by class, without asking the device which these are.
    places = classes.masked_fill(sky, CLASSES).flatten(1)
    pixels = images.new_zeros(count, CLASSES + 1).scatter_add_(1, places, torch.ones_like(places, dtype=images.dtype))
    light = images.new_zeros(count, CLASSES + 1).scatter_add_(1, places, images.mean(1).flatten(1))
    pixels, light = pixels[:, :CLASSES], light[:, :CLASSES]
    drawn = (chances.uniform(0, 1, count, CLASSES) * (pixels > 0)).argmax(1, keepdim=True)
    mean = (light / pixels.clamp(min=1)).gather(1, drawn) + 15 / 255 * chances.normal(count, 1)
    like_a_class = (chances.uniform(0, 1, count, 1) < 0.6) & (pixels.sum(1, keepdim=True) > 0)
    level = torch.where(like_a_class, mean, chances.uniform(40 / 255, 250 / 255, count, 1))
    rows, columns = int(chances.host.integers(2, 6)), int(chances.host.integers(2, 12))
    noise = chances.normal(count, 1, rows, columns) * chances.uniform(0, 20 / 255, count, 1, 1, 1)
    clouds = interpolate(noise, (height, width), mode="bicubic", align_corners=False)
    gradient = torch.linspace(-0.5, 0.5, height, device=images.device)[None, None, :, None]
    clouds = clouds + gradient * (40 / 255 * chances.normal(count, 1, 1, 1))
    colour = (level + 8 / 255 * chances.normal(count, 3))[..., None, None]
    # Twigs before it stay as they are, but for their edges, of which a part is sky.
    share = avg_pool2d(sky[:, None].float(), 3, 1, 1, count_include_pad=False) * chances.uniform(
        0.5, 1.0, count, 1, 1, 1
    )
    share = share * (sky.float().mean((1, 2)) >= LEAST_SKY)[:, None, None, None]
    return (images * (1 - share) + (colour + clouds) * share).clamp(0, 1)


def _haze(images: Tensor, depth_m: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    """Koschmieder's law, see `training.data.appearance`."""
    count = len(images)
    visibility_m = config.haze_visibility_m * 10 ** chances.uniform(0, 1, count, 1, 1)
    air = (chances.uniform(120, 240, count, 1) + 5 * chances.normal(count, 3))[..., None, None] / 255
    unknown = torch.isnan(depth_m)
    seen = (-3 * depth_m.nan_to_num(nan=torch.inf, posinf=torch.inf) / visibility_m).exp()
    seen = torch.where((unknown.float().mean((1, 2)) > 1 - HAZE_NEEDS)[:, None, None], 1.0, seen)[:, None]
    return (images * seen + air * (1 - seen)).clamp(0, 1)


def _tone_curve(images: Tensor, chances: Chances) -> Tensor:
    shape = (len(images), 1, 1, 1)
    low, high = chances.uniform(0, 0.4, *shape), chances.uniform(0.35, 1.0, *shape)
    bend, middle = chances.uniform(-0.7, 1.1, *shape).exp(), chances.uniform(-0.5, 1.0, *shape)
    x = images.clamp(0, 1) ** bend
    steep = x * x * (3 - 2 * x)
    return low + (high - low).clamp(min=0.2) * (x + middle * (steep - x))


def _channel_mixing(images: Tensor, chances: Chances) -> Tensor:
    count = len(images)
    share = chances.uniform(0, 0.5, count, 1, 1)
    # Exponential numbers, each row scaled to a sum of 1, are evenly spread over all mixtures.
    parts = -chances.uniform(1e-6, 1, count, 3, 3).log()
    mixing = (1 - share) * torch.eye(3, device=images.device) + share * parts / parts.sum(2, keepdim=True)
    return torch.einsum("nij,njhw->nihw", mixing, images)


def _spectrum(images: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    """Other amplitudes of low frequencies; their phases, and so places, stay."""
    count, side = len(images), SPECTRUM_SIDE
    small = interpolate(images, (side, side), mode="area")
    spectrum = torch.fft.rfft2(small)
    device = images.device
    frequency = torch.hypot(torch.fft.fftfreq(side, device=device)[:, None], torch.fft.rfftfreq(side, device=device))
    fading = (1 - frequency / 0.4).clamp(0, 1)
    fading[0, 0] = 0.3
    noise = chances.normal(count, 1, *frequency.shape) + 0.3 * chances.normal(count, 3, 1, 1)
    logarithm = chances.uniform(0, config.spectrum_strength, count, 1, 1, 1) * noise
    change = torch.fft.irfft2(spectrum * torch.expm1(logarithm * fading), s=(side, side))
    return images + interpolate(change, images.shape[2:], mode="bicubic", align_corners=False)


def _sharpen(images: Tensor, chances: Chances) -> Tensor:
    soft = blurred(images, chances.uniform(0.7, 2.0, len(images)))
    return images + chances.uniform(0.3, 2.0, len(images), 1, 1, 1) * (images - soft)


def _equalise(images: Tensor, chances: Chances) -> Tensor:
    parts = rgb_to_ycbcr(images)
    for index in range(len(images)):
        limit, cells = float(chances.host.uniform(1.0, 4.0)), int(chances.host.integers(1, 9))
        parts[index, :1] = equalize_clahe(parts[index, :1].clamp(0, 1), limit, (cells, cells))
    equalised: Tensor = ycbcr_to_rgb(parts).clamp(0, 1)
    return equalised


def _compress(images: Tensor, config: AppearanceConfig, chances: Chances) -> Tensor:
    quality = chances.uniform(config.jpeg_quality, 91, len(images)).floor()
    compressed: Tensor = jpeg_codec_differentiable(images, quality)
    return compressed
