"""Calibration of a confidence: reliability diagram and expected calibration error [Guo2017].

A confidence is the predicted probability that the dense depth is within 10 % of the truth. Pixels are sorted into ten
equal bins of confidence; in each the mean confidence (predicted) stands beside the share of right pixels (observed).
Sums are over the pixels of all frames.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.evaluation.measures.metrics import DepthRange, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray, ImageArray

BINS = 10
"""Equal bins of confidence between 0 and 1."""
TOLERANCE = 0.1
"""The dense depth is right where it is nearer to the truth than this share of the truth."""
LEAST_SHARE = 0.005
"""Bins with a smaller share of the pixels are left out of `Calibration.largest_fall`."""
DISTANCES = ("0-20", "20-50", "50-80")
_DISTANCE_BOUNDS_M = (20.0, 50.0)
SURFACES = ("road", "not road")
_UNKNOWN_TIME = ""


@dataclass(frozen=True)
class ReliabilityBin:
    """Pixels of similar confidence.

    Attributes:
        lower: Lower end of the bin.
        upper: Upper end of the bin.
        pixels: Their number.
        share: Their share of all pixels; NaN without any.
        predicted: Their mean confidence; NaN without pixels.
        observed: Share of them whose dense depth is right; NaN without pixels.
    """

    lower: float
    upper: float
    pixels: int
    share: float
    predicted: float
    observed: float

    def as_json(self) -> dict[str, float | int | None]:
        """Plain values, null where there is no number."""
        names = ("lower", "upper", "pixels", "share", "predicted", "observed")
        return {name: json_number(getattr(self, name)) for name in names}


@dataclass(frozen=True)
class Threshold:
    """What is left of some pixels at a minimum confidence, as with the node's parameter `min_confidence`.

    Attributes:
        min_confidence: The least confidence that is left.
        left: Share of the pixels that are left; NaN without any.
        right: Share of those whose dense depth is right; NaN where none is left.
    """

    min_confidence: float
    left: float
    right: float

    def as_json(self) -> dict[str, float | int | None]:
        """Plain values, null where there is no number."""
        return {name: json_number(getattr(self, name)) for name in ("min_confidence", "left", "right")}


@dataclass(frozen=True)
class Calibration:
    """Calibration of the confidence over some pixels.

    Attributes:
        bins: By confidence, the lowest first.
    """

    bins: tuple[ReliabilityBin, ...]

    @classmethod
    def of(cls, sums: npt.NDArray[np.float64]) -> Calibration:
        """From (3, BINS): pixels, sum of their confidences, right pixels."""
        pixels, confidence, right = sums
        with np.errstate(invalid="ignore"):
            columns = np.stack([pixels / pixels.sum(), confidence / pixels, right / pixels], axis=1)
        rows = zip(pixels.astype(np.int64).tolist(), columns.tolist(), strict=True)
        return cls(
            tuple(
                ReliabilityBin(index / BINS, (index + 1) / BINS, count, *values)
                for index, (count, values) in enumerate(rows)
            )
        )

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return sum(entry.pixels for entry in self.bins)

    @property
    def thresholds(self) -> tuple[Threshold, ...]:
        """What is left at a minimum confidence of each bin's lower end, the lowest first."""
        pixels = np.array([entry.pixels for entry in self.bins], np.float64)
        right = np.array([entry.pixels and entry.pixels * entry.observed for entry in self.bins])
        left, right_left = (np.cumsum(values[::-1])[::-1] for values in (pixels, right))
        with np.errstate(invalid="ignore"):
            columns = np.stack([left / pixels.sum(), right_left / left], axis=1)
        rows = zip(self.bins, columns.tolist(), strict=True)
        return tuple(Threshold(entry.lower, *values) for entry, values in rows)

    @property
    def ece(self) -> float:
        """Expected calibration error: mean distance of predicted and observed, weighted by pixels; NaN without any."""
        if not self.pixels:
            return math.nan
        return math.fsum(entry.share * abs(entry.predicted - entry.observed) for entry in self.bins if entry.pixels)

    @property
    def largest_fall(self) -> float:
        """Largest fall of the observed share from one bin to the next, 0 where it never falls; NaN without pixels.

        Bins with less than `LEAST_SHARE` of the pixels are left out.
        """
        if not self.pixels:
            return math.nan
        observed = [entry.observed for entry in self.bins if entry.share >= LEAST_SHARE]
        return max(0.0, -float(np.diff(observed).min(initial=0.0)))

    def as_json(self) -> dict[str, object]:
        """Plain values without the bins."""
        return {
            "pixels": self.pixels,
            "ece": json_number(self.ece),
            "largest_fall": json_number(self.largest_fall),
        }


@dataclass(frozen=True)
class Reliability:
    """Calibration of the confidence over all frames, and over parts of their pixels.

    Attributes:
        within_m: Pixels with ground truth within this range count.
        overall: Of all these pixels.
        by_time_of_day: By the drive's time of day; empty where no drive has one.
        by_distance: By distance of the ground truth, in metres: `DISTANCES`.
        by_surface: Of the road and of all else, `SURFACES`; empty where the drives have no classes.
    """

    within_m: float
    overall: Calibration
    by_time_of_day: Mapping[str, Calibration] = field(default_factory=dict)
    by_distance: Mapping[str, Calibration] = field(default_factory=dict)
    by_surface: Mapping[str, Calibration] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """Plain values: shares from 0 to 1, null where there is no number."""
        return {
            "within_m": self.within_m,
            **self.overall.as_json(),
            "bins": [entry.as_json() for entry in self.overall.bins],
            "thresholds": [entry.as_json() for entry in self.overall.thresholds],
            "by_time_of_day": _plain(self.by_time_of_day),
            "by_range": _plain(self.by_distance),
            "by_surface": _plain(self.by_surface),
        }


class ReliabilityAccumulator(Sums):
    """Sums the pixels of frames by confidence; memory does not grow with the number of frames.

    Args:
        within: Which ground truth counts.
    """

    SUMMED = ("_times", "_distances", "_surfaces")

    def __init__(self, within: DepthRange) -> None:
        self._range = within
        self._times: defaultdict[str, npt.NDArray[np.float64]] = defaultdict(lambda: np.zeros((3, BINS)))
        self._distances = np.zeros((len(DISTANCES), 3, BINS))
        self._surfaces = np.zeros((len(SURFACES), 3, BINS))

    def add(
        self,
        depth_m: FloatArray,
        confidence: FloatArray,
        truth_m: FloatArray,
        classes: ImageArray | None = None,
        time_of_day: str = _UNKNOWN_TIME,
    ) -> None:
        """Adds a frame.

        Args:
            depth_m: (H, W) float32 metres, taken as it is, not clipped; +inf is wrong.
            confidence: (H, W) float32, 0 to 1; a pixel with NaN, without a confidence, is left out.
            truth_m: (H, W) float32 metres, as in `DepthAccumulator.add`.
            classes: (H, W) uint8 of Cityscapes' training ids, 255 unknown; None where the drive has none.
            time_of_day: Of the drive; empty where unknown.
        """
        counts = (truth_m > self._range.lower_m) & (truth_m <= self._range.upper_m) & ~np.isnan(confidence)
        truth, predicted = truth_m[counts], np.clip(confidence[counts], 0.0, 1.0)
        right = np.abs(depth_m[counts] - truth) < np.float32(TOLERANCE) * truth
        bins = np.minimum((predicted * np.float32(BINS)).astype(np.int64), BINS - 1)
        # A bound belongs to the nearer part, as in (0, 20].
        by_distance = _sums(np.digitize(truth, _DISTANCE_BOUNDS_M, right=True), len(DISTANCES), bins, predicted, right)
        self._distances += by_distance
        self._times[time_of_day] += by_distance.sum(axis=0)
        if classes is not None:
            shown = classes[counts]
            known = shown < len(CLASS_NAMES)
            surface = (shown[known] != CLASS_NAMES.index("road")).astype(np.int64)
            self._surfaces += _sums(surface, len(SURFACES), bins[known], predicted[known], right[known])

    def result(self) -> Reliability:
        """The calibration so far."""
        times = {name: sums for name, sums in self._times.items() if name != _UNKNOWN_TIME and sums.any()}
        return Reliability(
            self._range.upper_m,
            Calibration.of(self._distances.sum(axis=0)),
            _calibrations(times, times.values()),
            _calibrations(DISTANCES, self._distances),
            _calibrations(SURFACES, self._surfaces) if self._surfaces.any() else {},
        )


def _sums(
    part: npt.NDArray[np.int64],
    parts: int,
    bins: npt.NDArray[np.int64],
    predicted: FloatArray,
    right: npt.NDArray[np.bool_],
) -> npt.NDArray[np.float64]:
    """(parts, 3, BINS) of pixels, confidences and right pixels; all but `parts` are (N,)."""
    place = part * BINS + bins
    rows = [np.bincount(place, weights, parts * BINS) for weights in (None, predicted, right)]
    return np.stack(rows).astype(np.float64).reshape(3, parts, BINS).swapaxes(0, 1)


def _calibrations(names: Iterable[str], sums: Iterable[npt.NDArray[np.float64]]) -> dict[str, Calibration]:
    return {name: Calibration.of(entry) for name, entry in zip(names, sums, strict=True)}


def _plain(parts: Mapping[str, Calibration]) -> dict[str, dict[str, object]]:
    return {name: calibration.as_json() for name, calibration in parts.items()}
