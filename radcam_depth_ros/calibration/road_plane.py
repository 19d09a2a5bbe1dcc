"""Camera height, pitch and roll above the road from LiDAR points, and the pooling of many such measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import DoubleArray

_LOWEST_M, _HIGHEST_M = 0.3, 6.0
"""A camera is mounted so high above the road."""
_TILT = 0.4
"""Slope of the road in the camera's axes at most: a camera looks ahead."""
_ASIDE_M, _REACH_M = 5.0, 16.0
_CELL_M = 0.4
_LEAST_CELLS = 40
_TRIES = 300
_NEAR_M = 0.08
_ERROR_M = 0.03
_BEND = 0.003
"""Change of slope a metre (standard deviation)."""
_FEWEST = 3
"""Fewer measurements say nothing of their spread."""


@dataclass(frozen=True)
class PlaneEstimate:
    """The road under the camera by one measurement.

    Attributes:
        height_m: Height of the camera.
        pitch_deg: How far it looks down.
        roll_deg: How far it leans to its right.
        deviations: Standard deviations of the three by the residuals.
    """

    height_m: float
    pitch_deg: float
    roll_deg: float
    deviations: tuple[float, float, float]

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Height, pitch and roll."""
        return self.height_m, self.pitch_deg, self.roll_deg


@dataclass(frozen=True)
class Pooled:
    """Many measurements in one.

    Attributes:
        numbers: Height (m), pitch and roll (degrees).
        deviations: Standard deviations of these.
        spreads: Standard deviations of a single measurement.
        count: How many measurements there were.
    """

    numbers: tuple[float, float, float]
    deviations: tuple[float, float, float]
    spreads: tuple[float, float, float]
    count: int


def pool(
    estimates: Sequence[PlaneEstimate], floors: tuple[float, float, float], independent: float = math.inf
) -> Pooled | None:
    """The median of measurements in the order of their times; None of too few.

    Neighbours in time share errors: the number of independent ones is that of a first-order autoregressive series.

    Args:
        estimates: The measurements.
        floors: Least standard deviations: height as a share, pitch and roll in degrees.
        independent: No more than so many of them are independent of one another.
    """
    if len(estimates) < _FEWEST:
        return None
    table = np.array([estimate.numbers for estimate in estimates])
    middle = np.median(table, axis=0)
    off = table - middle
    spreads = 1.4826 * np.median(np.abs(off), axis=0)
    clipped = np.clip(off, -3 * spreads, 3 * spreads)
    power = (clipped**2).sum(axis=0) + 1e-12
    alike = np.clip((clipped[1:] * clipped[:-1]).sum(axis=0) / power, 0.0, 0.9)
    counts = np.clip(len(table) * (1 - alike) / (1 + alike), 1.0, max(1.0, independent))
    # The median's deviation is that of the mean times the root of pi / 2.
    deviations = np.sqrt(np.pi / 2) * spreads / np.sqrt(counts)
    least = np.array([floors[0] * middle[0], *floors[1:]])
    deviations = np.hypot(deviations, least)
    return Pooled(_three(middle), _three(deviations), _three(spreads), len(table))


def _three(values: npt.NDArray[np.floating]) -> tuple[float, float, float]:
    height, pitch, roll = (float(value) for value in values)
    return height, pitch, roll


def fit_plane(points_m: FloatArray) -> PlaneEstimate | None:
    """The road in a scan; None where it has too little of it.

    A plane by RANSAC, then robust least squares of a surface that may bend along the way; the plane is that surface's
    tangent below the camera.

    Args:
        points_m: (N, 3) in the camera's axes.
    """
    cells = _cells(points_m)
    start = _ransac(cells) if len(cells) >= _LEAST_CELLS else None
    if start is None:
        return None
    # y = a + b x + c z + d z^2 / 2; y is down
    x, y, z = cells.T
    terms = np.stack([np.ones_like(x), x, z, z * z / 2], axis=1)
    prior = np.diag([0.0, 0.0, 0.0, (_ERROR_M / _BEND) ** 2])
    surface, slack_m = np.array([*start, 0.0]), 2 * _NEAR_M
    for _ in range(12):
        slack_m = max(_ERROR_M, slack_m * 0.7)
        off = y - terms @ surface
        weights = np.where(np.abs(off) < 4 * slack_m, 1 / (1 + (off / slack_m) ** 2) ** 2, 0.0)
        information = terms.T @ (weights[:, None] * terms) + prior
        surface = np.linalg.solve(information + 1e-9 * np.eye(4), terms.T @ (weights * y))
    used = np.abs(y - terms @ surface) < 2 * _ERROR_M
    if used.sum() < _LEAST_CELLS:
        return None
    error_m = float(np.sqrt(np.mean((y - terms @ surface)[used] ** 2)))
    deviations = np.sqrt(np.diag(np.linalg.pinv(information)))[:3] * error_m
    return _estimate(surface[:3], deviations)


def _estimate(plane: DoubleArray, deviations: DoubleArray) -> PlaneEstimate | None:
    """Of y = a + b x + c z."""
    length = float(np.sqrt(1 + plane[1] ** 2 + plane[2] ** 2))
    up = np.array([plane[1], -1.0, plane[2]]) / length
    height_m = float(plane[0]) / length
    if not _LOWEST_M <= height_m <= _HIGHEST_M:
        return None
    degrees = np.rad2deg([-np.arcsin(up[2]), np.arctan2(-up[0], -up[1])])
    sides = np.rad2deg(deviations[[2, 1]])
    return PlaneEstimate(
        height_m, float(degrees[0]), float(degrees[1]), (float(deviations[0]), float(sides[0]), float(sides[1]))
    )


def _cells(points_m: FloatArray) -> DoubleArray:
    """Mean places (M, 3) of the points near the road, one for each cell seen from above and each layer of a height."""
    x, y, z = points_m.T
    kept = (np.abs(x) < _ASIDE_M) & (np.abs(z) < _REACH_M) & (y > _LOWEST_M - _TILT * np.abs(z)) & (y < 2 * _HIGHEST_M)
    near = np.asarray(points_m[kept], np.float64)
    if not len(near):
        return near
    keys = np.floor(near / [_CELL_M, 2 * _NEAR_M, _CELL_M]).astype(np.int64)
    _, index, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    index = index.reshape(-1)
    sums = np.stack([np.bincount(index, near[:, axis], len(counts)) for axis in range(3)], axis=1)
    return np.asarray(sums / counts[:, None])


def _ransac(cells: DoubleArray) -> DoubleArray | None:
    """a, b, c of the plane y = a + b x + c z with most cells on it, less those below it."""
    triples = np.random.default_rng(len(cells)).integers(0, len(cells), (_TRIES, 3))
    corners = cells[triples]
    terms = np.stack([np.ones(corners.shape[:2]), corners[..., 0], corners[..., 2]], axis=-1)
    solvable = np.abs(np.linalg.det(terms)) > 2.0
    planes = np.linalg.solve(terms[solvable], corners[solvable][..., 1:2])[..., 0]
    likely = (np.abs(planes[:, 1:]) < _TILT).all(axis=1) & (planes[:, 0] > _LOWEST_M) & (planes[:, 0] < _HIGHEST_M)
    planes = planes[likely]
    if not len(planes):
        return None
    off = cells[:, 1] - (planes[:, :1] + planes[:, 1:2] * cells[:, 0] + planes[:, 2:] * cells[:, 2])
    score = (np.abs(off) < _NEAR_M).sum(axis=1) - (off > 2 * _NEAR_M).sum(axis=1)
    best = int(score.argmax())
    chosen: DoubleArray = planes[best]
    return chosen if int((np.abs(off[best]) < _NEAR_M).sum()) >= _LEAST_CELLS else None
