"""From radiance to a picture: exposure, colour, vignetting, blur, noise, tone."""

from __future__ import annotations

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray, ImageArray

_BRIGHTEST = 16.0
_STEPS = 4096


class Lens:
    """The optics, sensor and processing of one camera, drawn once; frames differ by exposure control and noise."""

    def __init__(self, rng: np.random.Generator, width: int, height: int) -> None:
        self._key = float(np.exp(rng.uniform(np.log(0.07), np.log(0.30))))
        self._metering = float(rng.uniform(0.5, 1.0))
        self._balance = np.exp(rng.normal(0, [0.06, 0.02, 0.08])).astype(np.float32)
        self._saturation = float(rng.uniform(0.55, 1.25))
        self._tone = _tone_curve(
            float(rng.uniform(1.9, 2.5)), float(rng.choice([0.0, 0.5, 1.0])), float(rng.uniform(-0.02, 0.04))
        )
        self._blur = float(rng.choice([0.0, rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.1)], p=[0.3, 0.5, 0.2]))
        self._sharpen = float(rng.uniform(0, 0.8)) if rng.random() < 0.4 else 0.0
        self._shot, self._read = float(rng.uniform(0.002, 0.02)), float(rng.uniform(0.001, 0.012))
        self._veil = float(rng.uniform(0, 0.04))
        fall = float(rng.uniform(0, 0.45))
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height) * height / width)
        self._vignette = (1 - fall * (x * x + y * y) / (1 + (height / width) ** 2)).astype(np.float32)[..., None]

    def develop(self, radiance: FloatArray, rng: np.random.Generator) -> ImageArray:
        """The picture (H, W, 3) uint8 RGB of linear radiance (H, W, 3)."""
        height = len(radiance)
        luminance = radiance @ np.array([0.25, 0.6, 0.15], np.float32)
        # Exposure control looks at all of the picture, or, like many cameras in vehicles, rather at the road.
        metered = luminance[int(height * (1 - self._metering)) :: 4, ::4]
        exposure = self._key / np.exp(np.log(np.maximum(metered, 1e-3)).mean()) * np.exp(rng.normal(0, 0.08))
        light = radiance * np.float32(exposure) * self._vignette * self._balance
        if self._veil > 0:
            light = light + np.float32(self._veil) * np.minimum(light, 4).mean(axis=(0, 1))
        if self._blur > 0:
            light = cv2.GaussianBlur(np.minimum(light, 8), (0, 0), self._blur)
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        light = light + noise * np.sqrt(np.float32(self._shot**2) * np.maximum(light, 0) + np.float32(self._read**2))
        light = np.maximum(light, 0)
        grey = light.mean(axis=-1, keepdims=True)
        light = np.maximum(grey + (light - grey) * np.float32(self._saturation), 0)
        # The square root spends the table's entries where the curve is steep.
        picture = self._tone[(np.sqrt(np.minimum(light, _BRIGHTEST)) * _STEPS).astype(np.uint16)]
        if self._sharpen > 0:
            picture = picture + self._sharpen * (picture - cv2.GaussianBlur(picture, (0, 0), 1.0))
        return np.asarray(np.clip(picture + 0.5, 0, 255), np.uint8)


def _tone_curve(gamma: float, filmic: float, black: float) -> FloatArray:
    """Picture values 0 to 255 by the square root of light.

    Args:
        gamma: The curve's power.
        filmic: Share of a curve with a toe and a shoulder (K. Narkowicz's fit to ACES); the rest clips.
        black: Where black ends up, as a share of white.
    """
    light = np.square(np.arange(int(np.sqrt(_BRIGHTEST) * _STEPS) + 1) / _STEPS)
    curve = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    tone = np.minimum(light, 1) ** (1 / gamma) * (1 - filmic) + np.minimum(curve, 1) ** (1 / gamma) * filmic
    return np.asarray((tone * (1 - black) + black) * 255, np.float32)
