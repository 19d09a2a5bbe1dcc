"""Depth metrics, taken for each frame and then averaged over frames.

Definitions follow the literature of this field ([Eigen2014]; ranges as in [Long2021] and its successors): ground
truth within (0, R] metres, predictions clipped to the same range.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray

LEAST_DEPTH_M = 1e-3
"""Predictions are clipped to no less than this, so that logarithms exist (0.001 to 80 m is the usual protocol)."""


@dataclass(frozen=True)
class DepthRange:
    """Which ground truth counts.

    Attributes:
        name: Name in results: "50", "10-30".
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
"""The ranges of published tables."""
BINS = tuple(
    DepthRange(f"{lower_m:g}-{upper_m:g}", lower_m, upper_m, 100.0)
    for lower_m, upper_m in ((0.0, 10.0), (10.0, 30.0), (30.0, 50.0), (50.0, 100.0))
)
"""By distance. Predictions may be anywhere within 100 m: clipping to a bin would hide what is wrong."""


MEASURES = ("mae", "rmse", "absrel", "log10", "rmselog", "d1", "d2", "d3")
"""Names of the measures, in the order of `measure`."""
ROOTS = [MEASURES.index(name) for name in ("rmse", "rmselog")]
"""Those that are roots of a mean."""


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


@dataclass(frozen=True)
class PixelErrors:
    """Errors of pixels, in the terms that all measures are made of; each (N,) float32.

    Attributes:
        absolute_m: |prediction - truth|, metres.
        relative: The same over the truth.
        log: |ln prediction - ln truth|.
    """

    absolute_m: FloatArray
    relative: FloatArray
    log: FloatArray

    @classmethod
    def of(cls, prediction_m: FloatArray, truth_m: FloatArray, clip_m: float) -> PixelErrors:
        """Compares; arguments as of `clipped`, and the truth (N,) float32 metres, positive and finite."""
        prediction = clipped(prediction_m, clip_m)
        absolute = np.abs(prediction - truth_m)
        return cls(absolute, absolute / truth_m, np.abs(np.log(prediction) - np.log(truth_m)))

    def terms(self) -> Iterator[npt.NDArray[np.generic]]:
        """What the measures are means of, before roots and units, in the order of `MEASURES`."""
        yield self.absolute_m
        yield np.square(self.absolute_m)
        yield self.relative
        yield self.log
        yield np.square(self.log)
        # max(p / t, t / p) < 1.25^k, without another two divisions.
        steps = self.log / np.float32(math.log(1.25))
        for power in (1, 2, 3):
            yield steps < power


def clipped(prediction_m: FloatArray, clip_m: float) -> FloatArray:
    """Predictions clipped to (0, clip_m]; a missing one (NaN) counts as clip_m: to leave it out would reward holes."""
    filled = np.where(np.isnan(prediction_m), np.float32(clip_m), prediction_m)
    inside: FloatArray = np.clip(filled, np.float32(LEAST_DEPTH_M), np.float32(clip_m))
    return inside


def absolute_error(prediction_m: FloatArray, truth_m: FloatArray, clip_m: float) -> FloatArray:
    """|prediction - truth| in metres; arguments as of `PixelErrors.of`."""
    error: FloatArray = np.abs(clipped(prediction_m, clip_m) - truth_m)
    return error


def measure(prediction_m: FloatArray, truth_m: FloatArray, clip_m: float) -> npt.NDArray[np.float64]:
    """Measures one frame.

    Args:
        prediction_m: (N,) float32 metres, N > 0; see `clipped`.
        truth_m: (N,) float32 metres, positive and finite.
        clip_m: Metres.

    Returns:
        (8,) float64 in the order of `MEASURES`.
    """
    errors = PixelErrors.of(prediction_m, truth_m, clip_m)
    # Values are float32 for speed; sums are not, since there may be a million of them.
    return _finished(np.array([term.mean(dtype=np.float64) for term in errors.terms()]))


def measure_labels(
    prediction_m: FloatArray, truth_m: FloatArray, labels: npt.NDArray[np.integer], count: int, clip_m: float
) -> npt.NDArray[np.float64]:
    """Measures the pixels of each label apart.

    Args:
        prediction_m: (N,) float32 metres; see `clipped`.
        truth_m: (N,) float32 metres, positive and finite.
        labels: (N,) whole numbers from 0 to `count` - 1.
        count: How many labels there are.
        clip_m: Metres.

    Returns:
        (count, 8) float64 in the order of `MEASURES`; NaN for labels without pixels.
    """
    errors = PixelErrors.of(prediction_m, truth_m, clip_m)
    pixels = np.bincount(labels, minlength=count)
    sums = [np.bincount(labels, term, minlength=count) for term in errors.terms()]
    with np.errstate(invalid="ignore"):
        return _finished(np.stack(sums, axis=1) / pixels[:, None])


def _finished(means: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The measures from the means of `PixelErrors.terms`, along the last axis."""
    means[..., ROOTS] = np.sqrt(means[..., ROOTS])
    means[..., MEASURES.index("log10")] /= math.log(10.0)
    return means


class FrameMean(Sums):
    """Averages measures over frames.

    Args:
        name: Name in results.
    """

    SUMMED = ("_sum", "_lost", "_frames", "_without")

    def __init__(self, name: str) -> None:
        self._name = name
        # With what rounding lost (Knuth's two-sum): the mean is the same whether frames are one drive or several.
        self._sum, self._lost = np.zeros(len(MEASURES)), np.zeros(len(MEASURES))
        self._frames = self._without = 0

    def add(self, measures: npt.NDArray[np.float64]) -> None:
        """Adds a frame's measures, (8,) in the order of `MEASURES`; a row of NaN is a frame without ground truth."""
        if np.isfinite(measures[0]):
            self._add(measures)
            self._frames += 1
        else:
            self._without += 1

    def join(self, plain: Mapping[str, Any]) -> None:
        """Adds the sums of other frames, see `Sums.join`."""
        self._add(np.asarray(plain["sum"]))
        super().join({**plain, "sum": np.zeros(len(MEASURES))})

    def _add(self, measures: npt.NDArray[np.float64]) -> None:
        total = self._sum + measures
        added = total - self._sum
        self._lost = self._lost + (self._sum - (total - added)) + (measures - added)
        self._sum = total

    def result(self) -> DepthMetrics:
        """The average so far."""
        means = (self._sum + self._lost) / self._frames if self._frames else np.full(len(MEASURES), np.nan)
        return DepthMetrics(self._name, self._frames, self._without, *(float(mean) for mean in means))


class DepthAccumulator(Sums):
    """Averages measures over frames, in several ranges at once.

    Args:
        ranges: The ranges.
    """

    SUMMED = ("_means",)

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self._ranges = tuple(ranges)
        self._means = tuple(FrameMean(entry.name) for entry in ranges)

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
        prediction, truth = known_pixels(prediction_m, truth_m, max(entry.upper_m for entry in self._ranges))
        measures = np.full((len(self._ranges), len(MEASURES)), np.nan)
        for index, entry in enumerate(self._ranges):
            inside = (truth > entry.lower_m) & (truth <= entry.upper_m)
            if inside.any():
                measures[index] = measure(prediction[inside], truth[inside], entry.clip_m)
            self._means[index].add(measures[index])
        return measures

    def result(self) -> tuple[DepthMetrics, ...]:
        """The averages so far, one for each range."""
        return tuple(mean.result() for mean in self._means)


def known_pixels(prediction_m: FloatArray, truth_m: FloatArray, farthest_m: float) -> tuple[FloatArray, FloatArray]:
    """The pixels whose ground truth is known and not farther than `farthest_m`: prediction and truth, (N,) metres.

    Raises:
        EvaluationError: when the sizes differ.
    """
    if prediction_m.shape != truth_m.shape:
        raise EvaluationError(
            f"prediction and ground truth must have one size, got {prediction_m.shape} and {truth_m.shape}; "
            "resample the prediction first"
        )
    known = (truth_m > 0) & (truth_m <= farthest_m)
    return prediction_m[known], truth_m[known]


def finite_shares(
    depth_m: FloatArray, truth_m: FloatArray, ranges: Sequence[DepthRange] = RANGES
) -> npt.NDArray[np.float64]:
    """Share of the pixels with ground truth in range whose depth is finite, (ranges,) float64; NaN without such pixels.

    Arguments as of `known_pixels`.
    """
    depth, truth = known_pixels(depth_m, truth_m, max(entry.upper_m for entry in ranges))
    finite = np.isfinite(depth)
    inside = ((truth > entry.lower_m) & (truth <= entry.upper_m) for entry in ranges)
    return np.array([finite[counts].mean() if counts.any() else math.nan for counts in inside])


@dataclass(frozen=True)
class SemiDenseMetrics:
    """The semi-dense image over a drive.

    Attributes:
        frames: Frames that were seen.
        coverage: Share of the pixels with ground truth within the widest range that have a value, averaged over the
            frames with such pixels; NaN without any.
        image_share: Share of all pixels of an image that have a value, sky and all, averaged over all frames.
        metrics: Where covered and ground truth exists, for each range; the last is the one that is usually quoted.
    """

    frames: int
    coverage: float
    image_share: float
    metrics: tuple[DepthMetrics, ...]

    def as_json(self) -> dict[str, object]:
        """Coverage and the measures of the widest range, and each range by its name."""
        widest = self.metrics[-1].as_json()
        ranges = {entry.name: entry.as_json() for entry in self.metrics}
        shares = {"coverage": json_number(self.coverage), "image_share": json_number(self.image_share)}
        return {**shares, **widest, **ranges}


class SemiDenseAccumulator(Sums):
    """Averages coverage and measures of semi-dense images over frames.

    Args:
        ranges: The ranges, the widest last.
    """

    SUMMED = ("_depth", "_coverage", "_image_share", "_frames", "_frames_with_truth")

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self._depth = DepthAccumulator(ranges)
        self._farthest_m = ranges[-1].upper_m
        self._coverage = self._image_share = 0.0
        self._frames = self._frames_with_truth = 0

    def add(self, semi_dense_m: FloatArray, truth_m: FloatArray) -> tuple[float, float]:
        """Adds a frame.

        Args:
            semi_dense_m: (H, W) float32 metres, NaN where there is no value.
            truth_m: (H, W) float32 metres, as in `DepthAccumulator.add`.

        Returns:
            The frame's own coverage, and the mean absolute error within the widest range where it has a value; NaN
            where there is no ground truth.

        Raises:
            EvaluationError: when the sizes differ.
        """
        semi_dense, truth = known_pixels(semi_dense_m, truth_m, self._farthest_m)
        covered = np.isfinite(semi_dense) & (semi_dense > 0)
        measures = self._depth.add(semi_dense[covered], truth[covered])
        self._frames += 1
        self._image_share += float((np.isfinite(semi_dense_m) & (semi_dense_m > 0)).mean())
        coverage = math.nan
        if truth.size:
            coverage = float(covered.mean())
            self._coverage += coverage
            self._frames_with_truth += 1
        return coverage, float(measures[-1, 0])

    def result(self) -> SemiDenseMetrics:
        """The averages so far."""
        coverage = self._coverage / self._frames_with_truth if self._frames_with_truth else math.nan
        image_share = self._image_share / self._frames if self._frames else math.nan
        return SemiDenseMetrics(self._frames, coverage, image_share, self._depth.result())
