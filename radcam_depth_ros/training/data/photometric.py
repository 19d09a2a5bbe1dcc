"""Augments light and colour: brightness, contrast, white balance, shadows, blur, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray, ImageArray

_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class PhotometricConfig:
    """Light and colour. Each effect has a probability and a strength.

    Attributes:
        tone: Probability of brightness, contrast and gamma, together.
        brightness: Largest change of the logarithm of brightness.
        contrast: Largest change of the logarithm of contrast.
        gamma: Largest change of the logarithm of gamma.
        colour: Probability of white balance and saturation, together.
        white_balance: Largest change of the logarithm of a channel.
        grey: Probability of no colour at all.
        illumination: Probability of a smooth random field of light: breaks the tie between brightness and distance.
        illumination_strength: Standard deviation of its logarithm.
        shadow: Probability of darkened patches, which dark asphalt and shadows are in real pictures.
        blur: Probability of a Gaussian blur of up to `blur_px`.
        blur_px: See `blur`.
        noise: Probability of noise of up to `noise_level`.
        noise_level: Largest standard deviation, of a range of 1.
    """

    tone: float
    brightness: float
    contrast: float
    gamma: float
    colour: float
    white_balance: float
    grey: float
    illumination: float
    illumination_strength: float
    shadow: float
    blur: float
    blur_px: float
    noise: float
    noise_level: float


def perceive(image: ImageArray, config: PhotometricConfig, rng: np.random.Generator) -> FloatArray:
    """Light and colour: (H, W, 3) uint8 to (H, W, 3) float32, 0 to 1."""
    curve = np.broadcast_to(np.linspace(0, 1, 256, dtype=np.float32)[:, None], (256, 3))
    if rng.random() < config.tone:
        gamma, contrast, brightness = np.exp(
            rng.uniform(-1, 1, 3) * [config.gamma, config.contrast, config.brightness]
        ).astype(np.float32)
        curve = ((curve**gamma - 0.5) * contrast + 0.5) * brightness
    saturation = 1.0
    if rng.random() < config.colour:
        curve = curve * np.exp(rng.uniform(-1, 1, 3) * config.white_balance).astype(np.float32)
        saturation = rng.uniform(0.2, 1.6)
    if rng.random() < config.grey:
        saturation = 0.0
    # One table look-up does all that depends on a pixel's value alone.
    result = np.stack([np.take(curve[:, channel], image[..., channel]) for channel in range(3)], axis=-1)
    if saturation != 1.0:
        # out = saturation * x + (1 - saturation) * luma, as one 3 x 3 matrix.
        mixing = np.eye(3, dtype=np.float32) * saturation + (1 - saturation) * np.tile(_LUMA, (3, 1))
        result = cv2.transform(result, mixing.astype(np.float32))
    light = _light(image.shape[0], image.shape[1], config, rng)
    if light is not None:
        result *= light[..., None]
    if rng.random() < config.blur:
        sigma = rng.uniform(0.3, max(config.blur_px, 0.3))
        result = cv2.GaussianBlur(result, (0, 0), sigma)
    if rng.random() < config.noise:
        level = np.float32(rng.uniform(0, config.noise_level))
        result += rng.standard_normal(result.shape, np.float32) * level
    clipped: FloatArray = np.clip(result, 0, 1, out=result)
    return clipped


def _light(height: int, width: int, config: PhotometricConfig, rng: np.random.Generator) -> FloatArray | None:
    """A factor for each pixel (H, W), or None for an even light."""
    light: FloatArray | None = None
    if rng.random() < config.illumination:
        rows, columns = rng.integers(2, 6, 2)
        field = rng.standard_normal((int(rows), int(columns)), np.float32) * np.float32(config.illumination_strength)
        light = np.exp(cv2.resize(field, (width, height), interpolation=cv2.INTER_CUBIC))
    if rng.random() < config.shadow:
        # Drawn small and enlarged: soft edges, and cheap.
        small = np.ones((height // 4, width // 4), np.float32)
        for _ in range(int(rng.integers(1, 4))):
            centre = rng.random(2) * [width / 4, height / 4]
            corners = centre + rng.standard_normal((int(rng.integers(3, 7)), 2)) * [width / 16, height / 16]
            darker = float(rng.uniform(0.3, 0.8))
            cv2.fillConvexPoly(small, cv2.convexHull(corners.astype(np.int32)), darker)
        small = cv2.GaussianBlur(small, (0, 0), float(rng.uniform(0.3, 3.0)))
        shadow = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
        light = shadow if light is None else light * shadow
    return light
