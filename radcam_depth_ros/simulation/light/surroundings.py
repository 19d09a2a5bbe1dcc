"""What glass and paint mirror where no ray is cast for it: roofs and trees before the sky, and the ground."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.tiles import fractal

_SIZE = 512


class Surroundings:
    """A panorama of a seed in polar form: how high things stand against the sky, and how bright they are."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Draws a panorama; in half of the seeds houses with straight edges stand in it, else trees."""
        rough = fractal(rng, _SIZE, 0.9)[0]
        steps = np.repeat(rng.standard_normal(_SIZE // 16), 16)
        shape = steps if rng.random() < 0.5 else rough
        self._height = np.asarray(np.maximum(rng.uniform(0.02, 0.3) * (1 + 0.6 * shape), 0.01), np.float32)
        self._tone = np.asarray(np.exp(0.4 * fractal(rng, _SIZE, 1.1)) * rng.uniform(0.06, 0.3), np.float32)
        self._ground = np.float32(rng.uniform(0.08, 0.3))

    def seen(self, direction: FloatArray, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How much sky (N,), and how bright the rest (N,) is that is seen from points (N, 3) in directions (N, 3).

        Brightness is relative to a white surface under the open sky.
        """
        # The panorama lies some 20 m away, so that it moves over a vehicle's windows.
        angle = np.arctan2(direction[:, 1] * 20 + point[:, 1], direction[:, 0] * 20 + point[:, 0])
        column = (angle * np.float32(_SIZE / (2 * np.pi))).astype(np.int32) & (_SIZE - 1)
        up = direction[:, 2]
        row = (up * np.float32(_SIZE)).astype(np.int32) & (_SIZE - 1)
        sky = np.clip((up - self._height[column]) * np.float32(25) + np.float32(0.5), 0, 1)
        below = np.clip(up * np.float32(40) + np.float32(0.5), 0, 1)
        tone = self._ground * (1 - below) + self._tone[row, column] * below
        return np.asarray(sky, np.float32), np.asarray(tone, np.float32)
