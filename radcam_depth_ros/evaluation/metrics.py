"""The measures of a depth image against ground truth, taken per frame and then averaged over frames.

Definitions follow the literature of this field (Eigen et al. 2014; ranges as in RC-PDA and its successors): ground
truth within (0, R] metres, predictions clipped to the same range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray, RadcamDepthError

LEAST_DEPTH_M = 1e-3
"""Predictions are clipped to no less than this, so that logarithms exist (0.001 to 80 m is the usual protocol)."""


class EvaluationError(RadcamDepthError):
    """An evaluation that cannot be made: nothing to measure, or images that do not fit together."""


@dataclass(frozen=True)
class DepthRange:
    """Which ground truth counts.

    Attributes:
        name: What the measures are filed under: "50", "10-30".
        lower_m: Ground truth must be farther than this.
        upper_m: Ground truth must not be farther than this.
        clip_m: Predictions are clipped to (0, clip_m].
    """

    name: str
    lower_m: float
    upper_m: float
    clip_m: float

    def __post_init__(self) -> None:
        if not 0 <= self.lower_m < self.upper_m < math.inf or not self.clip_m > LEAST_DEPTH_M:
            raise EvaluationError(
                "a range needs 0 <= lower < upper and a positive clip, finite and in metres, got "
                f"{self.lower_m}, {self.upper_m} and {self.clip_m}"
            )

    @classmethod
    def within(cls, upper_m: float, clip_m: float | None = None) -> DepthRange:
        """(0, upper_m], predictions clipped to the same unless said otherwise."""
        return cls(f"{upper_m:g}", 0.0, upper_m, upper_m if clip_m is None else clip_m)


RANGES = tuple(DepthRange.within(upper_m) for upper_m in (50.0, 70.0, 80.0))
"""The ranges that every table of the field has."""
BINS = tuple(
    DepthRange(f"{lower_m:g}-{upper_m:g}", lower_m, upper_m, 100.0)
    for lower_m, upper_m in ((0.0, 10.0), (10.0, 30.0), (30.0, 50.0), (50.0, 100.0))
)
"""By distance. Predictions may be anywhere within 100 m: clipping to a bin would hide what is wrong."""


MEASURES = ("mae", "rmse", "absrel", "log10", "rmselog", "d1", "d2", "d3")
"""Names of the measures, in the order of `measure`."""


@dataclass(frozen=True)
class DepthMetrics:
    """Averages over frames; all NaN where no frame had ground truth.

    Attributes:
        name: The range or class that was measured.
        frames: Frames with ground truth in range: those that were averaged.
        frames_without_truth: Frames that were left out since they had none.
        mae: Mean absolute error, metres.
        rmse: Root of the mean squared error, metres.
        absrel: Mean of |error| / truth.
        log10: Mean of |log10 prediction - log10 truth|.
        rmselog: Root of the mean squared error of natural logarithms.
        d1: Share of pixels whose ratio to the truth, either way, is below 1.25.
        d2: The same for 1.25^2.
        d3: The same for 1.25^3.
    """

    name: str
    frames: int
    frames_without_truth: int
    mae: float
    rmse: float
    absrel: float
    log10: float
    rmselog: float
    d1: float
    d2: float
    d3: float

    def as_json(self) -> dict[str, float | int | None]:
        """Plain values, null where there is no number."""
        return {key: json_number(getattr(self, key)) for key in (*MEASURES, "frames", "frames_without_truth")}


def json_number(value: float | int) -> float | int | None:
    """JSON has no NaN: null stands for "no value"."""
    return value if math.isfinite(value) else None


def measure(prediction_m: FloatArray, truth_m: FloatArray, clip_m: float) -> npt.NDArray[np.float64]:
    """Measures one frame.

    Args:
        prediction_m: (N,) float32 metres, N > 0. Clipped to (0, clip_m]; a missing prediction (NaN) counts as clip_m,
            since to leave it out would reward holes.
        truth_m: (N,) float32 metres, positive and finite.
        clip_m: Metres.

    Returns:
        (8,) float64 in the order of `MEASURES`.
    """
    filled = np.where(np.isnan(prediction_m), np.float32(clip_m), prediction_m)
    prediction = np.clip(filled, np.float32(LEAST_DEPTH_M), np.float32(clip_m))
    error = np.abs(prediction - truth_m)
    log_error = np.abs(np.log(prediction) - np.log(truth_m))
    # max(p / t, t / p) < 1.25^k, without another two divisions.
    steps = log_error / np.float32(math.log(1.25))
    # Values are float32 for speed; sums are not, since there may be a million of them.
    log_mean = float(log_error.mean(dtype=np.float64))
    return np.array(
        [
            error.mean(dtype=np.float64),
            math.sqrt(np.square(error).mean(dtype=np.float64)),
            (error / truth_m).mean(dtype=np.float64),
            log_mean / math.log(10.0),
            math.sqrt(np.square(log_error).mean(dtype=np.float64)),
            *(float((steps < power).mean()) for power in (1, 2, 3)),
        ]
    )


class DepthAccumulator:
    """Averages measures over frames, in several ranges at once.

    Args:
        ranges: The ranges.
    """

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self._ranges = tuple(ranges)
        self._sums = np.zeros((len(self._ranges), len(MEASURES)))
        self._frames = np.zeros(len(self._ranges), np.int64)
        self._without = np.zeros(len(self._ranges), np.int64)

    def add(self, prediction_m: FloatArray, truth_m: FloatArray) -> npt.NDArray[np.float64]:
        """Adds a frame.

        Args:
            prediction_m: float32 metres, (H, W) or any other shape.
            truth_m: Of the same shape, float32 metres; NaN where unknown, +inf beyond the range; neither counts.

        Returns:
            The frame's own measures, (ranges, 8) float64 in the order of `MEASURES`; NaN where it has no ground truth.

        Raises:
            EvaluationError: when the sizes differ.
        """
        if prediction_m.shape != truth_m.shape:
            raise EvaluationError(
                f"prediction and ground truth must have one size, got {prediction_m.shape} and {truth_m.shape}; "
                "resample the prediction first"
            )
        farthest_m = max(entry.upper_m for entry in self._ranges)
        known = (truth_m > 0) & (truth_m <= farthest_m)
        prediction, truth = prediction_m[known], truth_m[known]
        measures = np.full((len(self._ranges), len(MEASURES)), np.nan)
        for index, entry in enumerate(self._ranges):
            inside = (truth > entry.lower_m) & (truth <= entry.upper_m)
            if inside.any():
                measures[index] = measure(prediction[inside], truth[inside], entry.clip_m)
        measured = np.isfinite(measures[:, 0])
        self._frames += measured
        self._without += ~measured
        self._sums[measured] += measures[measured]
        return measures

    def result(self) -> tuple[DepthMetrics, ...]:
        """The averages so far, one for each range."""
        with np.errstate(invalid="ignore"):
            means = self._sums / self._frames[:, None]
        return tuple(
            DepthMetrics(entry.name, int(self._frames[i]), int(self._without[i]), *(float(mean) for mean in means[i]))
            for i, entry in enumerate(self._ranges)
        )


@dataclass(frozen=True)
class SemiDenseMetrics:
    """The semi-dense image over a drive.

    Attributes:
        frames: Frames that were seen.
        coverage: Share of all pixels of an image that have a value, averaged over all frames; NaN without frames.
        metrics: Where covered and ground truth exists, for each range; the last is the one that is usually quoted.
    """

    frames: int
    coverage: float
    metrics: tuple[DepthMetrics, ...]

    def as_json(self) -> dict[str, object]:
        """Coverage and the measures of the widest range, and each range by its name."""
        widest = self.metrics[-1].as_json()
        ranges = {entry.name: entry.as_json() for entry in self.metrics}
        return {"coverage": json_number(self.coverage), **widest, **ranges}


class SemiDenseAccumulator:
    """Averages coverage and measures of semi-dense images over frames.

    Args:
        ranges: The ranges, the widest last.
    """

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self._depth = DepthAccumulator(ranges)
        self._coverage = 0.0
        self._frames = 0

    def add(self, semi_dense_m: FloatArray, truth_m: FloatArray) -> None:
        """Adds a frame.

        Args:
            semi_dense_m: (H, W) float32 metres, NaN where there is no value.
            truth_m: (H, W) float32 metres, as in `DepthAccumulator.add`.

        Raises:
            EvaluationError: when the sizes differ.
        """
        covered = np.isfinite(semi_dense_m) & (semi_dense_m > 0)
        truth = np.where(covered, truth_m, np.float32(np.nan)) if covered.shape == truth_m.shape else truth_m
        self._depth.add(semi_dense_m, truth)
        self._frames += 1
        self._coverage += float(covered.mean())

    def result(self) -> SemiDenseMetrics:
        """The averages so far."""
        coverage = self._coverage / self._frames if self._frames else math.nan
        return SemiDenseMetrics(self._frames, coverage, self._depth.result())
