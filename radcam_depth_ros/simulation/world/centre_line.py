"""The road's centre line: world positions, headings and banks of places along and beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.settings.randomness import pick

DoubleArray = npt.NDArray[np.float64]

_BANKED_M, _LEVEL_M = 12.0, 60.0


class CentreLine:
    """A gently winding line that starts at the world's origin along x.

    Positions are given as `s`, metres along the line, and `t`, metres to its left. The road is tilted sideways about
    the line, in curves above all; the land beside it takes that up.
    """

    def __init__(
        self, rng: np.random.Generator, start_m: float, stop_m: float, min_radius_m: float, max_bank: float = 0.0
    ) -> None:
        """Draws a line.

        Args:
            rng: Random generator.
            start_m: The line is known from here (may be negative)
            stop_m: to here; beyond both it goes on straight.
            min_radius_m: No curve is tighter.
            max_bank: The road is tilted sideways no more than this, metres of rise a metre.
        """
        self._s = np.arange(np.floor(start_m), np.ceil(stop_m) + 1.0)
        waves = rng.uniform(180, 1100, 5)
        phases = rng.uniform(0, 2 * np.pi, 5)
        weights = rng.uniform(0.2, 1, 5) * waves
        curvature = np.zeros_like(self._s)
        for wave, phase, weight in zip(waves, phases, weights, strict=True):
            curvature += weight / wave * np.cos(2 * np.pi * self._s / wave + phase)
        # Many roads are straight; the square root of nothing in between is as common as the tightest.
        sharpness = float(rng.choice([0.0, 0.3, 1.0], p=[0.25, 0.4, 0.35]) * rng.uniform(0.3, 1.0))
        curvature *= sharpness / (min_radius_m * max(np.abs(curvature).max(), 1e-9))
        # The outer side of a curve is the higher one; where a road was mended again and again it tilts anyhow.
        inwards = -curvature / max(np.abs(curvature).max(), 1e-9)
        anyhow = np.sin(2 * np.pi * self._s / rng.uniform(60, 400) + rng.uniform(0, 2 * np.pi))
        share = rng.uniform(0, 1)
        strength = max_bank * pick(rng, (0.0, 0.3, 1.0), (0.3, 0.4, 0.3)) * rng.uniform(0.3, 1.0)
        self._bank = strength * (share * inwards + (1 - share) * anyhow)
        self._is_level = strength <= 0.0
        heading = np.cumsum(curvature)
        self._heading = heading - np.interp(0.0, self._s, heading)
        x, y = np.cumsum(np.cos(self._heading)), np.cumsum(np.sin(self._heading))
        self._x, self._y = x - np.interp(0.0, self._s, x), y - np.interp(0.0, self._s, y)

    def heading(self, s: npt.ArrayLike) -> DoubleArray:
        """Direction at `s`, radians from x to the left."""
        return np.asarray(np.interp(np.asarray(s, np.float64), self._s, self._heading), np.float64)

    def position(self, s: npt.ArrayLike, t: npt.ArrayLike) -> DoubleArray:
        """World x and y, (..., 2) float64, of places along and beside the line."""
        along = np.asarray(s, np.float64)
        heading = self.heading(along)
        beyond = along - np.clip(along, self._s[0], self._s[-1])
        x = np.interp(along, self._s, self._x) + beyond * np.cos(heading)
        y = np.interp(along, self._s, self._y) + beyond * np.sin(heading)
        return np.stack([x - np.asarray(t) * np.sin(heading), y + np.asarray(t) * np.cos(heading)], axis=-1)

    def camber(self, s: npt.ArrayLike, t: npt.ArrayLike) -> DoubleArray:
        """Height that the road's sideways tilt adds at places along and beside the line, metres."""
        across = np.asarray(t, np.float64)
        if self._is_level:
            return np.zeros(np.broadcast_shapes(np.shape(s), across.shape))
        away = np.clip((np.abs(across) - _BANKED_M) / (_LEVEL_M - _BANKED_M), 0, 1)
        bank = np.interp(np.asarray(s, np.float64), self._s, self._bank)
        return np.asarray(bank * np.clip(across, -_BANKED_M, _BANKED_M) * (1 - away) ** 2, np.float64)

    def tilted(self, mesh: Mesh, s: float, t: float) -> Mesh:
        """A mesh in world coordinates, placed on a level road at (s, t), tilted as the road is there."""
        if self._is_level:
            return mesh
        if abs(t) > _BANKED_M:
            # Beside the road the land hardly tilts: things stand upright on it.
            lift = np.array([0.0, 0.0, float(self.camber(s, t))], np.float32)
            return replace(mesh, corners=mesh.corners + lift)
        heading = float(self.heading(s))
        offset = mesh.corners[..., :2] - self.position(s, t)
        across = t + offset[..., 1] * np.cos(heading) - offset[..., 0] * np.sin(heading)
        corners = mesh.corners.copy()
        corners[..., 2] += self.camber(s, across).astype(np.float32)
        return replace(mesh, corners=corners)
