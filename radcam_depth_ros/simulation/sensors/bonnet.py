"""The own vehicle at the lower edge of the picture: a bonnet, or a dashboard."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.surfaces import Label
from radcam_depth_ros.simulation.objects.vehicles import paint
from radcam_depth_ros.simulation.sensors.camera import View


class Bonnet:
    """What of the own vehicle one camera sees, drawn once."""

    def __init__(self, rng: np.random.Generator, width: int, height: int) -> None:
        """Draws a bonnet or a dashboard for images of a size in pixels."""
        across = np.linspace(-1, 1, width) - rng.normal(0, 0.15)
        rise, bend = rng.uniform(0.03, 0.16), rng.uniform(0.0, 0.09)
        dashboard = rng.random() < 0.4
        edge = 1 - rise + bend * across**2
        if rng.random() < 0.5:
            # Raised wings, or the instruments' hood.
            edge -= rng.uniform(0.01, 0.05) * np.exp(-(((across - rng.uniform(-0.6, 0.6)) / 0.25) ** 2))
        row = (np.arange(height) / height)[:, None]
        below = np.clip((row - edge) * height + 0.5, 0, 1)
        self._mask = cv2.GaussianBlur(below, (0, 0), rng.uniform(0.8, 4.0)).astype(np.float32)[..., None]
        # Nothing of what the bonnet shows through is left to learn from.
        self._unknown = self._mask[..., 0] > 0.02
        self._albedo = np.array((0.03, 0.03, 0.032) if dashboard else paint(rng), np.float32)
        depth = np.clip((row - edge) / max(rise, 0.05), 0, 1)
        self._mirror = ((0.04 if dashboard else 0.4) * (1 - depth) ** 3 + 0.04).astype(np.float32)[..., None]
        self._shade = (rng.uniform(0.5, 1.0) * (1 - 0.4 * depth)).astype(np.float32)[..., None]
        self._first = int(np.argmax(self._unknown.any(axis=1)))

    def before(self, view: View, sky: FloatArray) -> View:
        """The view with the own vehicle in front: its depth is NaN there, its class `Label.IGNORE`.

        Args:
            view: Of the camera.
            sky: (3,) light from all of the sky, relative.
        """
        first = self._first
        radiance, depth, label = view.radiance.copy(), view.depth_m.copy(), view.label.copy()
        mask, part = self._mask[first:], radiance[first:]
        # It mirrors, blurred and upside down, what is above its edge.
        above = view.radiance[max(0, 2 * first - len(radiance)) : first][::-1]
        mirrored = cv2.resize(cv2.blur(above, (9, 9)), part.shape[1::-1]) if len(above) else part
        light = np.maximum(np.asarray(sky, np.float32), part.mean(axis=(0, 1)))
        own = self._albedo * light * self._shade[first:] + self._mirror[first:] * mirrored
        radiance[first:] = part * (1 - mask) + own * mask
        depth[self._unknown], label[self._unknown] = np.nan, Label.IGNORE
        return replace(view, radiance=radiance, depth_m=depth, label=label)

    def held(self, motion_px_s: FloatArray) -> FloatArray:
        """Motion (h, w, 2) through the picture, without what moves along with the camera."""
        height, width = motion_px_s.shape[:2]
        free = cv2.resize((~self._unknown).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(motion_px_s * free[..., None], np.float32)
