"""Develops radiance into a picture as one camera does: exposure, optics, noise, colour, tone."""

from __future__ import annotations

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.simulation.sensors.optics import Optics, smeared
from radcam_depth_ros.simulation.settings.looks import NO_LOOKS, Looks
from radcam_depth_ros.simulation.settings.randomness import log_uniform, pick

_LUMINANCE = np.array([0.25, 0.6, 0.15], np.float32)
_BRIGHTEST = 16.0
_STEPS = 4096
# Exposure of a day, which the exposure times and noise that are drawn belong to.
_DAY = 0.3
_LONGEST_S, _MOST_GAIN = 1 / 60, 8.0


class CameraUnit:
    """The optics, sensor and processing of one camera, drawn once; frames differ by exposure control and noise."""

    def __init__(
        self,
        rng: np.random.Generator,
        width: int,
        height: int,
        rain: float = 0.0,
        random: bool = False,
        looks: Looks = NO_LOOKS,
    ) -> None:
        """Draws a camera.

        Args:
            rng: Random generator.
            width: Pixels.
            height: Pixels.
            rain: How much rain falls on it, 0 to 1.
            random: Whether its tones may be such as few cameras have.
            looks: What its pictures have; nothing without.
        """
        self._optics = Optics(rng, width, height, rain, looks.dirt)
        self._key = log_uniform(rng, 0.08, 0.36)
        self._metering = rng.uniform(0.5, 1.0)
        # Exposure control misses, and it cannot make a day of the night.
        self._unsteady, self._floor = rng.uniform(0.03, 0.25), log_uniform(rng, 1e-4, 8e-4)
        self._shutter_s = log_uniform(rng, 3e-4, 5e-3)
        self._balance = np.exp(rng.normal(0, [0.07, 0.02, 0.09])).astype(np.float32)
        # How far white balance goes towards a grey mean: the colour of dusk and of street lamps remains in part.
        self._adapts = rng.uniform(0.5, 0.95) if looks.white_balance else rng.uniform(0, 0.3)
        self._saturation = rng.uniform(0.55, 1.25) if rng.random() < 0.97 else 0.0
        self._tone = _tone_curve(rng, random)
        self._sharpen = rng.uniform(0, 1.0) if rng.random() < 0.65 else 0.0
        self._halo_px = rng.uniform(0.6, 1.6)
        self._mosaic = bool(rng.random() < 0.5)
        self._shot, self._read = rng.uniform(0.002, 0.02), rng.uniform(0.001, 0.008)

    def develop(
        self, radiance: FloatArray, rng: np.random.Generator, motion_px_s: FloatArray | None = None
    ) -> ImageArray:
        """The picture (H, W, 3) uint8 RGB of linear radiance (H, W, 3).

        Args:
            radiance: Relative to a white surface under the open sky.
            rng: For noise and exposure control.
            motion_px_s: (H, W, 2) motion through the picture, pixels a second; may be coarser than the picture.
        """
        height = len(radiance)
        coarse = radiance[::4, ::4]
        luminance = coarse @ _LUMINANCE
        # Exposure control looks at all of the picture, or, like many cameras in vehicles, rather at the road.
        metered = luminance[int(height * (1 - self._metering)) // 4 :]
        # What is far brighter than the rest, as lamps are and the sun, counts as clipped.
        usual = float(np.exp(np.log(np.maximum(metered, 1e-6)).mean()))
        mean = float(np.minimum(metered, 10 * usual).mean())
        exposure = self._key / (mean + self._floor) * float(np.exp(rng.normal(0, self._unsteady)))
        shutter_s = min(self._shutter_s * max(exposure / _DAY, 1.0), max(_LONGEST_S, self._shutter_s))
        gain = float(np.clip(exposure / _DAY * self._shutter_s / shutter_s, 1, _MOST_GAIN))
        light = radiance * (np.float32(exposure) * self._balance * self._gains(coarse, 10 * usual))
        if motion_px_s is not None:
            light = smeared(np.minimum(light, np.float32(60)), motion_px_s * np.float32(shutter_s))
        light = self._noisy(self._optics.through(light, rng), gain, rng)
        light = self._coloured(light)
        # The square root spends the table's entries where the curve is steep.
        index = (np.sqrt(np.minimum(light, _BRIGHTEST)) * _STEPS).astype(np.uint16)
        picture = self._tone[index]
        if self._sharpen > 0:
            picture = picture + self._sharpen * (picture - cv2.GaussianBlur(picture, (0, 0), self._halo_px))
        return np.asarray(np.clip(picture + 0.5, 0, 255), np.uint8)

    def _gains(self, coarse: FloatArray, bright: float) -> FloatArray:
        """(3,) gains of white balance for radiance (h, w, 3): what is brighter than `bright` does not count."""
        mean = np.minimum(coarse, np.float32(bright)).mean(axis=(0, 1), dtype=np.float64) + 1e-9
        grey = float(mean @ _LUMINANCE)
        # Cameras correct from about 2500 to 10,000 K, no further.
        return np.asarray(np.clip(grey / mean, 0.4, 2.5) ** self._adapts, np.float32)

    def _noisy(self, light: FloatArray, gain: float, rng: np.random.Generator) -> FloatArray:
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        variance = np.float32(self._shot**2 * gain) * np.maximum(light, 0) + np.float32((self._read * gain**0.7) ** 2)
        return np.asarray(np.maximum(light + noise * np.sqrt(variance), 0), np.float32)

    def _coloured(self, light: FloatArray) -> FloatArray:
        grey = light.mean(axis=-1, keepdims=True)
        colour = light - grey
        if self._mosaic:
            # A sensor measures one colour a pixel: colours are less sharp than shapes, noise in them is coarser.
            colour = cv2.blur(colour, (3, 3))
        return np.asarray(np.maximum(grey + colour * np.float32(self._saturation), 0), np.float32)


def _tone_curve(rng: np.random.Generator, random: bool) -> FloatArray:
    """Picture values 0 to 255 by the square root of light.

    The curve's power, a share of one with a toe and a shoulder (K. Narkowicz's fit to ACES), contrast about the middle,
    and where black and white end up: from hard ones to flat grey ones.
    """
    light = np.square(np.arange(int(np.sqrt(_BRIGHTEST) * _STEPS) + 1) / _STEPS)
    gamma = float(rng.uniform(1.4, 2.8) if random else rng.uniform(1.8, 2.5))
    filmic = pick(rng, (0.0, 0.5, 1.0), (0.65, 0.2, 0.15))
    curve = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    tone = np.minimum(light, 1) ** (1 / gamma) * (1 - filmic) + np.minimum(curve, 1) ** (1 / gamma) * filmic
    contrast = rng.uniform(-0.1, 0.8)
    tone = tone + contrast * (tone * tone * (3 - 2 * tone) - tone)
    flat = rng.random() < 0.12
    black = float(rng.uniform(0.05, 0.22) if flat else rng.uniform(-0.02, 0.08))
    white = float(rng.uniform(0.75, 0.95) if flat else 1.0)
    return np.asarray((tone * (white - black) + black) * 255, np.float32)
