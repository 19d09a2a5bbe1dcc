"""Errors of small things by distance: of people, two-wheelers, poles and signs, and of cars for comparison.

Sums are over the pixels of all frames. `ClassMeans` averages over frames instead, as published tables do, so its MAE of
a class differs. The median is read off a histogram of errors, whose bins do not depend on the data: the sums of several
parts of the frames add up to those of the whole.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.evaluation.measures.metrics import absolute_error, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray, ImageArray

THINGS = ("person", "rider", "bicycle", "motorcycle", "pole", "traffic sign", "car")
"""Names of the classes that are measured."""
STRETCHES = ("0-10", "10-20", "20-30", "30-50", "50-80")
_BOUNDS_M = (0.0, 10.0, 20.0, 30.0, 50.0, 80.0)
LEAST_ERROR_M = 0.001
"""Smaller errors count as this much in the median."""
MOST_ERROR_M = 1000.0
"""Larger errors count as this much in the median."""
ERROR_STEP = 1.01
"""Upper end of a bin of the histogram over its lower end: a median is within 0.5 % of the exact one."""
_BINS = math.ceil(math.log(MOST_ERROR_M / LEAST_ERROR_M, ERROR_STEP))
_UNMEASURED = 255
_THING_OF_CLASS = np.full(256, _UNMEASURED, np.uint8)
_THING_OF_CLASS[[CLASS_NAMES.index(name) for name in THINGS]] = np.arange(len(THINGS))


@dataclass(frozen=True)
class ThingErrors:
    """Errors over the pixels of one class at some distance; NaN without pixels.

    Attributes:
        pixels: Their number.
        mae_m: Mean absolute error, metres.
        median_m: Median of the absolute error, metres, to 0.5 %.
    """

    pixels: int
    mae_m: float
    median_m: float

    @classmethod
    def of(cls, total_m: float, histogram: npt.NDArray[np.int64]) -> ThingErrors:
        """From the sum of the errors in metres, and how many of them are in each bin."""
        pixels = int(histogram.sum())
        if not pixels:
            return cls(0, math.nan, math.nan)
        middle = int(np.searchsorted(np.cumsum(histogram), (pixels + 1) // 2))
        return cls(pixels, total_m / pixels, LEAST_ERROR_M * ERROR_STEP ** (middle + 0.5))

    def as_json(self) -> dict[str, float | int | None]:
        """Plain values, null where there is no number."""
        return {"mae": json_number(self.mae_m), "median": json_number(self.median_m), "pixels": self.pixels}


class ThingAccumulator(Sums):
    """Sums the errors of `THINGS` by distance; memory does not grow with the number of frames.

    Args:
        clip_m: Predictions are clipped to (0, clip_m], at all distances.
    """

    SUMMED = ("_sum", "_histogram")

    def __init__(self, clip_m: float) -> None:
        self._clip_m = clip_m
        self._sum = np.zeros((len(THINGS), len(STRETCHES)))
        self._histogram = np.zeros((len(THINGS), len(STRETCHES), _BINS), np.int64)

    def add(self, depth_m: FloatArray, truth_m: FloatArray, classes: ImageArray) -> None:
        """Adds a frame.

        Args:
            depth_m: (H, W) float32 metres.
            truth_m: (H, W) float32 metres, as in `DepthAccumulator.add`.
            classes: (H, W) uint8 of Cityscapes' training ids, 255 unknown.
        """
        thing = _THING_OF_CLASS[classes]
        counts = (thing != _UNMEASURED) & (truth_m > _BOUNDS_M[0]) & (truth_m <= _BOUNDS_M[-1])
        truth = truth_m[counts]
        error = absolute_error(depth_m[counts], truth, self._clip_m)
        # A bound belongs to the nearer stretch, as in (0, 10].
        part = thing[counts].astype(np.int64) * len(STRETCHES) + np.digitize(truth, _BOUNDS_M[1:-1], right=True)
        steps = np.log(np.clip(error, LEAST_ERROR_M, MOST_ERROR_M) / LEAST_ERROR_M) / math.log(ERROR_STEP)
        place = part * _BINS + np.minimum(steps.astype(np.int64), _BINS - 1)
        self._sum += np.bincount(part, error, self._sum.size).reshape(self._sum.shape)
        self._histogram += np.bincount(place, minlength=self._histogram.size).reshape(self._histogram.shape)

    def plain(self) -> dict[str, Any]:
        """As of all sums; of the histogram only the bins that are not empty, which are few."""
        places = np.flatnonzero(self._histogram)
        counts = self._histogram.ravel()[places]
        return {"sum": self._sum.tolist(), "histogram": [places.tolist(), counts.tolist()]}

    def join(self, plain: Mapping[str, Any]) -> None:
        """Adds the sums of other frames, see `Sums.join`."""
        histogram = np.zeros(self._histogram.size, np.int64)
        places, counts = plain["histogram"]
        histogram[np.asarray(places, np.int64)] = counts
        super().join({**plain, "histogram": histogram.reshape(self._histogram.shape)})

    def result(self) -> dict[str, dict[str, ThingErrors]]:
        """The errors so far, by class and distance: within 80 m, then each of `STRETCHES`.

        Classes without ground truth are left out.
        """
        entries = zip(THINGS, self._sum, self._histogram, strict=True)
        return {name: _by_distance(total, histogram) for name, total, histogram in entries if histogram.any()}


def things_json(things: Mapping[str, Mapping[str, ThingErrors]]) -> dict[str, dict[str, object]]:
    """Plain values of `ThingAccumulator.result`, metres."""
    return {
        name: {distance: errors.as_json() for distance, errors in by_distance.items()}
        for name, by_distance in things.items()
    }


def _by_distance(total: npt.NDArray[np.float64], histogram: npt.NDArray[np.int64]) -> dict[str, ThingErrors]:
    """From (stretches,) and (stretches, bins)."""
    parts = {name: ThingErrors.of(*sums) for name, *sums in zip(STRETCHES, total.tolist(), histogram, strict=True)}
    return {f"{_BOUNDS_M[-1]:g}": ThingErrors.of(float(total.sum()), histogram.sum(axis=0)), **parts}
