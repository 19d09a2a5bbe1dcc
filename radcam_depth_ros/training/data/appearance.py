"""Augments the appearance of surfaces, sky and air, and the camera's processing.

Against what all pictures of a simulator share, which a network would take for a property of streets. Each effect is off
by default and has a probability of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.errors import TrainingError

HAZE_NEEDS = 0.8
"""Share of the pixels whose depth must be known for haze: what a LiDAR leaves out would stay clear."""
LEAST_SKY = 0.01
"""Share of the pixels from which on there is a sky to change."""
SPECTRUM_SIDE = 32
"""Fourier amplitudes are changed in an image of this size: that is where its low frequencies are."""


@dataclass(frozen=True)
class AppearanceConfig:
    """What a street looks like. Names without a unit, share or strength are probabilities.

    Attributes:
        recolour: Of other colours for whole classes, where there are class images.
        recolour_share: Share of the classes that get them.
        recolour_strength: How much of the new colour replaces the old one, at most.
        texture: Of a random smooth texture on whole classes, where there are class images.
        texture_strength: Standard deviation of the logarithm of its brightness, at most.
        sky: Of another sky, where there is one: often as bright as some surface, since not all that is bright is sky.
        haze: Of haze, where most depths are known.
        haze_visibility_m: Shortest visibility; the longest is ten times that.
        tone_curve: Of a strong curve: flat and grey, dark, or washed out.
        channel_mixing: Of colour channels that are mixed with one another, by up to half.
        spectrum: Of other amplitudes of low spatial frequencies.
        spectrum_strength: Standard deviation of their logarithm, at most.
        equalise: Of a locally equalised histogram (CLAHE).
        sharpen: Of an unsharp mask, as cameras have it.
        jpeg: Of compression with a quality between `jpeg_quality` and 90.
        jpeg_quality: See `jpeg`.
    """

    recolour: float
    recolour_share: float
    recolour_strength: float
    texture: float
    texture_strength: float
    sky: float
    haze: float
    haze_visibility_m: float
    tone_curve: float
    channel_mixing: float
    spectrum: float
    spectrum_strength: float
    equalise: float
    sharpen: float
    jpeg: float
    jpeg_quality: int

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name not in ("haze_visibility_m", "jpeg_quality") and not 0 <= value <= 1:
                raise TrainingError(f"appearance.{entry.name} must be between 0 and 1, got {value}")
        if self.haze_visibility_m <= 0 or not 1 <= self.jpeg_quality <= 90:
            raise TrainingError(
                "appearance needs haze_visibility_m above 0 and jpeg_quality of 1 to 90, got "
                f"{self.haze_visibility_m} and {self.jpeg_quality}"
            )


def restyle(
    image: ImageArray,
    depth_m: npt.NDArray[np.float16],
    classes: npt.NDArray[np.uint8],
    config: AppearanceConfig,
    rng: np.random.Generator,
) -> ImageArray:
    """Other surfaces and air: what is in front of the lens.

    Args:
        image: (H, W, 3) uint8 RGB.
        depth_m: (H, W) metres; NaN unknown, +inf sky.
        classes: (H, W), 255 unknown.
        config: Probabilities and strengths.
        rng: Where all randomness comes from.

    Returns:
        (H, W, 3) uint8.
    """
    if rng.random() < config.recolour:
        image = _recolour(image, classes, config, rng)
    if rng.random() < config.texture:
        image = _texture(image, classes, config, rng)
    if rng.random() < config.sky:
        image = _sky(image, depth_m, classes, rng)
    if rng.random() < config.haze:
        image = _haze(image, depth_m, config, rng)
    return image


def develop(image: FloatArray, config: AppearanceConfig, rng: np.random.Generator) -> FloatArray:
    """What cameras do to a picture: (H, W, 3) float32, 0 to 1, before and after."""
    if rng.random() < config.tone_curve:
        image = _tone_curve(image, rng)
    if rng.random() < config.channel_mixing:
        share = rng.uniform(0, 0.5)
        mixing = (1 - share) * np.eye(3) + share * rng.dirichlet(np.ones(3), 3)
        image = cv2.transform(image, mixing.astype(np.float32))
    if rng.random() < config.spectrum:
        image = image + _spectrum_change(image, config, rng)
    if rng.random() < config.sharpen:
        soft = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.7, 2.0)))
        amount = float(rng.uniform(0.3, 2.0))
        image = cv2.addWeighted(image, 1 + amount, soft, -amount, 0)
    equalised, compressed = rng.random() < config.equalise, rng.random() < config.jpeg
    image = np.clip(image, 0, 1, dtype=np.float32)
    if equalised or compressed:
        rounded = np.rint(image * np.float32(255)).astype(np.uint8)
        if equalised:
            rounded = _equalise(rounded, rng)
        if compressed:
            rounded = _compress(rounded, config, rng)
        image = rounded.astype(np.float32) / np.float32(255)
    return image


def _chosen(classes: npt.NDArray[np.uint8], share: float, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    """Which of 256 classes get an effect: never the unknown one, which holds unlike things."""
    chosen: npt.NDArray[np.bool_] = rng.random(256) < share
    chosen[UNKNOWN_CLASS] = False
    return chosen


def _recolour(
    image: ImageArray, classes: npt.NDArray[np.uint8], config: AppearanceConfig, rng: np.random.Generator
) -> ImageArray:
    """An affine map of each channel for each chosen class, drawn anew: towards a colour, with another contrast."""
    strength = (_chosen(classes, config.recolour_share, rng) * rng.uniform(0, config.recolour_strength, 256))[:, None]
    colour = rng.uniform(20, 235, (256, 1)) + rng.normal(0, 25, (256, 3))
    contrast = rng.uniform(0.3, 1.3, (256, 1))
    slope = (1 - strength) + strength * contrast
    offset = strength * (colour - 128 * contrast)
    values = np.arange(256)[None, :, None] * slope[:, None, :] + offset[:, None, :]
    table = np.clip(values, 0, 255).astype(np.uint8).reshape(256 * 256, 3)
    start = classes.astype(np.int32) * 256
    channels = [np.take(table[:, channel], start + image[..., channel]) for channel in range(3)]
    return np.stack(channels, axis=-1)


def _texture(
    image: ImageArray, classes: npt.NDArray[np.uint8], config: AppearanceConfig, rng: np.random.Generator
) -> ImageArray:
    """Random brightness of several sizes, stronger in some classes than in others and none in the rest."""
    height, width = classes.shape
    field = np.zeros((height, width), np.float32)
    for cell in 2 ** rng.uniform(1, 6, 2):
        noise = rng.standard_normal((int(height / cell) + 2, int(width / cell) + 2), np.float32)
        field += cv2.resize(noise, (width, height), interpolation=cv2.INTER_LINEAR)
    strength = _chosen(classes, config.recolour_share, rng) * rng.uniform(-1, 1, 256) * config.texture_strength
    factor = cv2.exp(field * np.take(strength.astype(np.float32), classes))
    textured: ImageArray = np.clip(image * factor[..., None], 0, 255).astype(np.uint8)
    return textured


def _sky(
    image: ImageArray, depth_m: npt.NDArray[np.float16], classes: npt.NDArray[np.uint8], rng: np.random.Generator
) -> ImageArray:
    """A cloudy sky with a gradient, as bright as the mean of one of the classes or as any; mixed with the old one."""
    sky = np.isinf(depth_m)
    if sky.mean() < LEAST_SKY:
        return image
    height, width = sky.shape
    known = np.unique(classes[~sky])
    chosen = ~sky & (classes == rng.choice(known)) if len(known) and rng.random() < 0.6 else None
    level = rng.uniform(40, 250) if chosen is None else float(image[chosen].mean()) + rng.normal(0, 15)
    noise = rng.standard_normal((rng.integers(2, 6), rng.integers(2, 12)), np.float32) * np.float32(rng.uniform(0, 20))
    clouds = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    clouds += np.linspace(-0.5, 0.5, height, dtype=np.float32)[:, None] * np.float32(rng.normal(0, 40))
    colour = (level + rng.normal(0, 8, 3)).astype(np.float32)
    # Twigs before it stay as they are, but for their edges, of which a part is sky.
    share = cv2.blur(sky.astype(np.float32), (3, 3))[..., None] * np.float32(rng.uniform(0.5, 1.0))
    changed: ImageArray = np.clip(image * (1 - share) + (colour + clouds[..., None]) * share, 0, 255).astype(np.uint8)
    return changed


def _haze(
    image: ImageArray, depth_m: npt.NDArray[np.float16], config: AppearanceConfig, rng: np.random.Generator
) -> ImageArray:
    """Koschmieder's law: the air's colour replaces a thing's by 1 - exp(-3 depth / visibility)."""
    visibility_m = config.haze_visibility_m * 10 ** rng.uniform(0, 1)
    air = (rng.uniform(120, 240) + rng.normal(0, 5, 3)).astype(np.float32)
    depth = depth_m.astype(np.float32)
    unknown = np.isnan(depth)
    if unknown.mean() > 1 - HAZE_NEEDS:
        return image
    seen = cv2.exp(np.where(unknown, -np.inf, -3 * depth / np.float32(visibility_m)).astype(np.float32))[..., None]
    hazy: ImageArray = np.clip(image * seen + air * (1 - seen), 0, 255).astype(np.uint8)
    return hazy


def _tone_curve(image: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A rising curve of random ends, bend and middle contrast, of 64 steps."""
    low, high = rng.uniform(0, 0.4), rng.uniform(0.35, 1.0)
    bend, middle = np.exp(rng.uniform(-0.7, 1.1)), rng.uniform(-0.5, 1.0)
    x = np.linspace(0, 1, 256) ** bend
    steep = x * x * (3 - 2 * x)
    curve = (low + max(high - low, 0.2) * (x + middle * (steep - x))).astype(np.float32)
    index = np.rint(np.clip(image, 0, 1) * np.float32(255)).astype(np.uint8)
    bent: FloatArray = np.take(curve, index)
    return bent


def _spectrum_change(image: FloatArray, config: AppearanceConfig, rng: np.random.Generator) -> FloatArray:
    """What to add so that the amplitudes of low frequencies are multiplied; their phases, and so places, stay."""
    height, width = image.shape[:2]
    small = cv2.resize(image, (SPECTRUM_SIDE, SPECTRUM_SIDE), interpolation=cv2.INTER_AREA)
    spectrum = np.fft.rfft2(small, axes=(0, 1))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(SPECTRUM_SIDE), np.fft.rfftfreq(SPECTRUM_SIDE), indexing="ij"))
    # Fading out towards the highest, so that enlarging adds no ripples.
    fading = np.clip(1 - frequency / 0.4, 0, 1)[..., None]
    # The mean is one number that all else stands on: as much of it would often leave black or white alone.
    fading[0, 0] = 0.3
    strength = rng.uniform(0, config.spectrum_strength)
    logarithm = strength * (rng.standard_normal(frequency.shape)[..., None] + 0.3 * rng.standard_normal((1, 1, 3)))
    change = np.fft.irfft2(spectrum * np.expm1(logarithm * fading), s=small.shape[:2], axes=(0, 1))
    enlarged: FloatArray = cv2.resize(change.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    return enlarged


def _equalise(image: ImageArray, rng: np.random.Generator) -> ImageArray:
    limit, cells = float(rng.uniform(1.0, 4.0)), int(rng.integers(1, 9))
    parts = cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb)
    parts[..., 0] = cv2.createCLAHE(limit, (cells, cells)).apply(np.ascontiguousarray(parts[..., 0]))
    equalised: ImageArray = cv2.cvtColor(parts, cv2.COLOR_YCrCb2RGB)
    return equalised


def _compress(image: ImageArray, config: AppearanceConfig, rng: np.random.Generator) -> ImageArray:
    quality = int(rng.integers(config.jpeg_quality, 91))
    # Channels in the wrong order would swap red and blue of both ways alike, but not their weights in the luminance.
    _, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded: ImageArray | None = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if decoded is None:
        raise TrainingError(f"an image of {image.shape} cannot be compressed as JPEG; set appearance.jpeg to 0")
    return decoded[..., ::-1]
