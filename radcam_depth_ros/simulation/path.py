"""The road's centre line: from (distance along, distance to the left) to the world and back to headings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

DoubleArray = npt.NDArray[np.float64]


class Path:
    """A gently winding line, flat, that starts at the world's origin along x.

    Positions are given as `s`, metres along the line, and `t`, metres to its left.
    """

    def __init__(self, rng: np.random.Generator, start_m: float, stop_m: float, min_radius_m: float) -> None:
        """Draws a line.

        Args:
            rng: Random generator.
            start_m: The line is known from here (may be negative)
            stop_m: to here; beyond both it goes on straight.
            min_radius_m: No curve is tighter.
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
