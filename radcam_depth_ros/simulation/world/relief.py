"""Height of the ground, road included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.settings.randomness import pick

_SHORTEST_M, _LONGEST_M = 80.0, 900.0
_ROUNDEST_M = 450.0
_DIFFERENCE_M = 0.5


class Relief:
    """Height of the ground at each place of the world: a few long waves, 0 at the origin."""

    def __init__(self, rng: np.random.Generator, max_slope: float) -> None:
        """Draws a relief; three in ten are flat, and none is steeper than `max_slope`, metres of rise a metre."""
        waves = 4
        shortest = pick(rng, (_SHORTEST_M, 220.0))
        length = np.exp(rng.uniform(np.log(shortest), np.log(_LONGEST_M), waves))
        direction = rng.uniform(0, 2 * np.pi, waves)
        share = rng.dirichlet(np.ones(waves))
        steepest = max_slope * rng.uniform(0.2, 1.0) * float(rng.random() < 0.7)
        self._phase = rng.uniform(0, 2 * np.pi, waves)
        self._rate = 2 * np.pi / length[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
        # A wave of height a and length l is as steep as 2 pi a / l: the slopes of all waves add up to the steepest.
        # Crests and dips are as round as roads are built.
        slope = np.minimum(steepest * share, length / (2 * np.pi * _ROUNDEST_M))
        self._amplitude = slope * length / (2 * np.pi)
        self._base = float((self._amplitude * np.sin(self._phase)).sum())
        self._is_flat = steepest <= 0.0

    def height(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Height in metres at places in metres."""
        total = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        if self._is_flat:
            return total
        for rate, phase, amplitude in zip(self._rate, self._phase, self._amplitude, strict=True):
            total += amplitude * np.sin(np.asarray(x) * rate[0] + np.asarray(y) * rate[1] + phase)
        return total - self._base

    def slope(self, x: float, y: float) -> npt.NDArray[np.float64]:
        """Rise a metre towards x and towards y, (2,)."""
        steps = _DIFFERENCE_M * np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
        heights = self.height(x + steps[0], y + steps[1])
        return np.array([heights[0] - heights[1], heights[2] - heights[3]]) / (2 * _DIFFERENCE_M)

    def lifted(self, mesh: Mesh) -> Mesh:
        """A mesh that was built on flat ground, in world coordinates, moved up and down with the ground below it."""
        if self._is_flat:
            return mesh
        corners = mesh.corners.copy()
        corners[..., 2] += self.height(corners[..., 0], corners[..., 1]).astype(np.float32)
        return replace(mesh, corners=corners)
