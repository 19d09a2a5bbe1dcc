"""Sparsification curves of a confidence [Ilg2018].

The error of the remaining pixels over the share that is removed, least confident first, beside an oracle that removes
the largest errors first. The area between the two (AUSE) is 0 for a confidence that orders pixels as their errors do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.measures.metrics import DepthRange, absolute_error, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray

REMOVED = tuple(step / 20 for step in range(20))
"""Shares of the pixels that are removed: 0 to 95 %."""
_LEVELS = 1 << 16
"""Steps of confidence between 0 and 1."""


@dataclass(frozen=True)
class SparsificationCurve:
    """One metric over the shares that are removed.

    Attributes:
        by_confidence: Metres, one for each of `REMOVED`, the least confident pixels removed.
        oracle: The same with the largest errors removed.
    """

    by_confidence: tuple[float, ...]
    oracle: tuple[float, ...]

    @property
    def ause_m(self) -> float:
        """Area between the curves over the share that is taken away, 0 to 0.95, metres; NaN without ground truth."""
        gap = np.subtract(self.by_confidence, self.oracle)
        widths = np.diff(REMOVED)
        return float((0.5 * (gap[1:] + gap[:-1]) * widths).sum())

    @property
    def rise_m(self) -> float:
        """How much larger the error becomes, at most, from one share to the next, metres; 0 where it never does."""
        return float(np.diff(self.by_confidence).max(initial=0.0))

    @property
    def falls(self) -> bool:
        """Whether taking away more never makes the error larger."""
        return self.rise_m == 0.0

    def as_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "by_confidence": [json_number(value) for value in self.by_confidence],
            "oracle": [json_number(value) for value in self.oracle],
            "ause": json_number(self.ause_m),
            "falls": self.falls,
            "rise": json_number(self.rise_m),
        }


@dataclass(frozen=True)
class Sparsification:
    """Averages over frames.

    Attributes:
        within_m: Ground truth within this range counts.
        frames: Frames with ground truth.
        mae: Of the mean absolute error.
        rmse: Of the root mean squared error.
    """

    within_m: float
    frames: int
    mae: SparsificationCurve
    rmse: SparsificationCurve

    def as_json(self) -> dict[str, object]:
        """Plain values: shares from 0 to 1, errors in metres."""
        return {
            "within_m": self.within_m,
            "frames": self.frames,
            "removed": list(REMOVED),
            "mae": self.mae.as_json(),
            "rmse": self.rmse.as_json(),
        }


class SparsificationAccumulator(Sums):
    """Averages the curves of frames; what it holds does not grow with them.

    Args:
        within: Which ground truth counts.
    """

    SUMMED = ("_sum", "_frames")

    def __init__(self, within: DepthRange) -> None:
        self._range = within
        self._sum = np.zeros((4, len(REMOVED)))
        self._frames = 0

    def add(self, depth_m: FloatArray, confidence: FloatArray, truth_m: FloatArray) -> None:
        """Adds a frame.

        Args:
            depth_m: (H, W) float32 metres.
            confidence: (H, W) float32, 0 to 1; NaN counts as 0.
            truth_m: (H, W) float32 metres, as in `DepthAccumulator.add`.
        """
        counts = (truth_m > self._range.lower_m) & (truth_m <= self._range.upper_m)
        if not counts.any():
            return
        error = absolute_error(depth_m[counts], truth_m[counts], self._range.clip_m)
        square = np.square(error)
        level = (np.clip(np.nan_to_num(confidence[counts]), 0, 1) * (_LEVELS - 1)).astype(np.int64)
        pixels = np.bincount(level, minlength=_LEVELS).astype(np.int64)
        by_level = (np.bincount(level, values, _LEVELS).astype(np.float64) for values in (error, square))
        curves = [_remaining_mean(pixels, sums) for sums in by_level]
        # In the oracle's order the most confident, last, has the smallest error.
        ordered = np.sort(error)[::-1].astype(np.float64)
        ones = np.ones(len(ordered), np.int64)
        curves += [_remaining_mean(ones, values) for values in (ordered, np.square(ordered))]
        by_mae, by_mse, oracle_mae, oracle_mse = curves
        self._sum += [by_mae, oracle_mae, np.sqrt(by_mse), np.sqrt(oracle_mse)]
        self._frames += 1

    def result(self) -> Sparsification:
        """The averages so far."""
        means = self._sum / self._frames if self._frames else np.full_like(self._sum, math.nan)
        by_mae, oracle_mae, by_rmse, oracle_rmse = (tuple(row.tolist()) for row in means)
        mae, rmse = SparsificationCurve(by_mae, oracle_mae), SparsificationCurve(by_rmse, oracle_rmse)
        return Sparsification(self._range.upper_m, self._frames, mae, rmse)


def _remaining_mean(pixels: npt.NDArray[np.int64], sums: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The mean of what is left, for each of `REMOVED`.

    Where the cut lies within a level its pixels are left in part, each as likely as the others: pixels of one
    confidence have no order.

    Args:
        pixels: (L,) how many pixels each level has, the levels in the order in which they are taken away.
        sums: (L,) sums of their values.
    """
    before = np.concatenate([[0.0], np.cumsum(pixels, dtype=np.float64)])
    removed = before[-1] * np.array(REMOVED)
    # From the end: the difference of two large sums would lose the small errors that are left.
    left = np.concatenate([np.cumsum(sums[::-1])[::-1], [0.0]])
    means: npt.NDArray[np.float64] = np.interp(removed, before, left) / (before[-1] - removed)
    return means
