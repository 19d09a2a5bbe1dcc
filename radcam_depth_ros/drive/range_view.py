"""Range image of one LiDAR scan on a grid of azimuth and elevation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray

_COLUMNS = 720  # of 0.5 degrees
_ROWS = 80
_ROW_RAD = np.deg2rad(0.75)
"""Half a degree by three quarters: with its neighbours a cell reaches over the gap between two beams, and is still
narrow enough to tell a car from what is beside it."""


class Verdict(IntEnum):
    """What a scan says of a point that it did not measure itself."""

    UNKNOWN = 0
    AGREES = 1
    SEEN_THROUGH = 2
    HIDDEN = 3
    OPEN = 4


@dataclass(frozen=True)
class Tolerance:
    """How far two ranges of the same thing may differ."""

    metres: float
    share: float


class RangeView:
    """Nearest and farthest range around each direction, among the cell and its eight neighbours.

    Args:
        points_m: (N, 3) metres around the sensor, z up.
    """

    def __init__(self, points_m: FloatArray) -> None:
        cell, range_m = _cells(points_m)
        near = np.full(_ROWS * _COLUMNS, np.inf, np.float32)
        far = np.full(_ROWS * _COLUMNS, -np.inf, np.float32)
        inside = cell >= 0
        self._top = int(cell.max(initial=-1)) // _COLUMNS
        np.minimum.at(near, cell[inside], range_m[inside])
        np.maximum.at(far, cell[inside], range_m[inside])
        # Half precision: 0.03 m at 60 m, and a window of scans takes a quarter of the memory.
        self._near = _spread(near.reshape(_ROWS, _COLUMNS), np.minimum).astype(np.float16).ravel()
        self._far = _spread(far.reshape(_ROWS, _COLUMNS), np.maximum).astype(np.float16).ravel()

    def check(self, points_m: FloatArray, tolerance: Tolerance) -> npt.NDArray[np.uint8]:
        """The `Verdict` on each of some points (N, 3), metres around the sensor, z up.

        A point is seen through when all returns around its direction are clearly behind it, and hidden when all are
        clearly in front. Between the two it may be part of what the scan saw: the road rises through many ranges
        within a cell. Where nothing came back it is unknown, but for directions upwards: that is the sky.
        """
        cell, range_m = _cells(points_m)
        near, far = self._near[cell].astype(np.float32), self._far[cell].astype(np.float32)
        slack = tolerance.metres + tolerance.share * range_m
        verdict = np.full(len(points_m), Verdict.AGREES, np.uint8)
        verdict[range_m < near - slack] = Verdict.SEEN_THROUGH
        verdict[range_m > far + slack] = Verdict.HIDDEN
        verdict[np.isinf(near)] = Verdict.UNKNOWN
        verdict[np.isinf(near) & (points_m[:, 2] > 0) & (cell // _COLUMNS <= self._top)] = Verdict.OPEN
        verdict[cell < 0] = Verdict.UNKNOWN
        return verdict


def _cells(points_m: FloatArray) -> tuple[npt.NDArray[np.int32], FloatArray]:
    """The cell of each point, -1 outside of the grid, and its range."""
    x, y, z = points_m[:, 0], points_m[:, 1], points_m[:, 2]
    flat = np.hypot(x, y)
    column = ((np.arctan2(y, x) + np.float32(np.pi)) * np.float32(_COLUMNS / (2 * np.pi))).astype(np.int32) % _COLUMNS
    row = np.floor(np.arctan2(z, flat) / np.float32(_ROW_RAD)).astype(np.int32) + _ROWS // 2
    cell = np.where((row >= 0) & (row < _ROWS), row * _COLUMNS + column, -1)
    return cell.astype(np.int32), np.hypot(flat, z)


def _spread(grid: FloatArray, extreme: np.ufunc) -> FloatArray:
    """The extreme of each cell and its neighbours; columns go round."""
    result = extreme(extreme(grid, np.roll(grid, 1, axis=1)), np.roll(grid, -1, axis=1))
    taller: FloatArray = result.copy()
    extreme(taller[1:], result[:-1], out=taller[1:])
    extreme(taller[:-1], result[1:], out=taller[:-1])
    return taller
