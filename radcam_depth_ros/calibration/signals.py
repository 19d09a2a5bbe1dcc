"""Signals over time, and the time shift between two of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.geometry import DoubleArray

LARGEST_SHIFT_S = 0.5
_STEP_S = 0.01
_BLOCKS = 8
_FEWEST = 20
_LARGEST_ERROR_S = 0.06
"""A shift with a larger error counts as unknown."""
_LEAST_CORRELATION = 0.6
_GAP_S = 0.4
_OUTLIER = 4.0


@dataclass(frozen=True)
class Signal:
    """A quantity at several times.

    Attributes:
        times_s: (N,) float64, ascending, seconds.
        values: (N,) float64, finite.
    """

    times_s: DoubleArray
    values: DoubleArray

    @classmethod
    def of(cls, times_s: Sequence[float], values: Sequence[float]) -> Signal:
        """Of times in any order and values of which some may be NaN."""
        times, numbers = np.asarray(times_s, np.float64), np.asarray(values, np.float64)
        kept = np.isfinite(numbers)
        times, numbers = times[kept], numbers[kept]
        order = np.argsort(times, kind="stable")
        return cls(times[order], numbers[order])

    def at(self, times_s: DoubleArray) -> DoubleArray:
        """Values in between, (n,); NaN outside and in gaps."""
        if len(self.times_s) < 2:
            return np.full(len(times_s), np.nan)
        values: DoubleArray = np.interp(times_s, self.times_s, self.values, left=np.nan, right=np.nan)
        after = np.searchsorted(self.times_s, times_s).clip(1, len(self.times_s) - 1)
        values[self.times_s[after] - self.times_s[after - 1] > _GAP_S] = np.nan
        return values


@dataclass(frozen=True)
class Shift:
    """Time to add to one signal so that it fits another.

    Attributes:
        seconds: The shift; NaN where unknown.
        error_s: Its standard deviation.
        correlation: Of the two signals, once shifted.
        problem: Why it is unknown; empty where it is known.
    """

    seconds: float
    error_s: float
    correlation: float
    problem: str = ""

    @property
    def is_known(self) -> bool:
        """Whether the shift is known."""
        return not self.problem


def estimate_shift(late: Signal, reference: Signal, least_error_s: float = 0.01) -> Shift:
    """Estimates the time shift between two signals, which may differ by scale and offset.

    The shift of the highest correlation; its error is that of leaving out an eighth of the time at once (jackknife).

    Args:
        late: The signal that is shifted.
        reference: The other one.
        least_error_s: No error is less: leaving out parts does not show what is wrong all the time.
    """
    if min(len(late.times_s), len(reference.times_s)) < _FEWEST:
        return Shift(np.nan, np.nan, np.nan, "there are too few values")
    shifts = np.arange(-LARGEST_SHIFT_S, LARGEST_SHIFT_S + _STEP_S / 2, _STEP_S)
    inside = (late.times_s >= reference.times_s[0] + LARGEST_SHIFT_S) & (
        late.times_s <= reference.times_s[-1] - LARGEST_SHIFT_S
    )
    there = np.stack([reference.at(late.times_s[inside] + shift) for shift in shifts])
    known = np.isfinite(there).all(axis=0)
    there, values = there[:, known], late.values[inside][known]
    if len(values) < _FEWEST:
        return Shift(np.nan, np.nan, np.nan, "too few values are of the same time")
    kept = _without_outliers(values, there)
    there, values = there[:, kept], values[kept]
    best, correlation = _best(values, there, shifts)
    block = np.arange(len(values)) * _BLOCKS // len(values)
    left_out = np.array([_best(values[block != one], there[:, block != one], shifts)[0] for one in range(_BLOCKS)])
    error_s = float(np.sqrt((_BLOCKS - 1) / _BLOCKS * ((left_out - left_out.mean()) ** 2).sum()))
    error_s = max(error_s, least_error_s)
    if not correlation >= _LEAST_CORRELATION:
        return Shift(best, error_s, correlation, "the two do not vary alike")
    if error_s > _LARGEST_ERROR_S:
        return Shift(best, error_s, correlation, "they vary too little or too slowly")
    if abs(best) >= LARGEST_SHIFT_S - 1.5 * _STEP_S:
        return Shift(best, error_s, correlation, f"no shift within {LARGEST_SHIFT_S:g} s fits best")
    return Shift(best, error_s, correlation)


def _without_outliers(values: DoubleArray, there: DoubleArray) -> np.typing.NDArray[np.bool_]:
    """Leaves out what no shift explains, such as the speed of a lorry taken for the road's."""
    kept = np.ones(len(values), bool)
    for _ in range(3):
        correlations = _correlations(values[kept], there[:, kept])
        if not np.isfinite(correlations).any():
            break
        reference = there[int(np.nanargmax(correlations))]
        slope, offset = np.polyfit(reference[kept], values[kept], 1)
        apart = np.abs(values - slope * reference - offset)
        spread = 1.4826 * float(np.median(apart[kept])) + 1e-6
        kept = apart < _OUTLIER * spread
    return kept


def _correlations(values: DoubleArray, there: DoubleArray) -> DoubleArray:
    first = values - values.mean()
    second = there - there.mean(axis=1, keepdims=True)
    size = np.linalg.norm(first) * np.linalg.norm(second, axis=1)
    correlations: DoubleArray = np.divide(second @ first, size, out=np.full(len(there), np.nan), where=size > 1e-9)
    return correlations


def _best(values: DoubleArray, there: DoubleArray, shifts: DoubleArray) -> tuple[float, float]:
    """The shift of the highest correlation, between the steps by a parabola, and that correlation."""
    correlations = _correlations(values, there)
    if not np.isfinite(correlations).any():
        return 0.0, 0.0
    peak = int(np.nanargmax(correlations))
    if 0 < peak < len(shifts) - 1 and np.isfinite(correlations[peak - 1 : peak + 2]).all():
        before, top, after = correlations[peak - 1 : peak + 2]
        bend = before - 2 * top + after
        if bend < 0:
            return float(shifts[peak] + _STEP_S * (before - after) / (2 * bend)), float(top)
    return float(shifts[peak]), float(correlations[peak])
