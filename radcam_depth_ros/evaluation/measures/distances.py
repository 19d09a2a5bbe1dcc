"""Mean absolute error by distance of the ground truth, in steps of 5 m."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.evaluation.measures.metrics import absolute_error, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray

STEP_M = 5.0
FARTHEST_M = 100.0
"""End of the curve; predictions are clipped to it."""


@dataclass(frozen=True)
class DistanceCurve:
    """Mean absolute error by distance of the ground truth.

    Attributes:
        mae_m: Metres, for each stretch of `STEP_M` from 0 on; NaN where there was no ground truth.
    """

    mae_m: tuple[float, ...]

    @property
    def middles_m(self) -> tuple[float, ...]:
        """The middle of each stretch, metres."""
        return tuple(STEP_M * (index + 0.5) for index in range(len(self.mae_m)))

    def as_json(self) -> list[float | int | None]:
        """Plain values."""
        return [json_number(value) for value in self.mae_m]


class DistanceAccumulator(Sums):
    """Averages the errors of frames by distance."""

    SUMMED = ("_sum", "_frames")

    def __init__(self) -> None:
        count = round(FARTHEST_M / STEP_M)
        self._sum, self._frames = np.zeros(count), np.zeros(count, np.int64)

    def add(self, depth_m: FloatArray, truth_m: FloatArray) -> None:
        """Adds a frame; both (H, W) float32 metres, as in `DepthAccumulator.add`."""
        counts = (truth_m > 0) & (truth_m < FARTHEST_M)
        truth = truth_m[counts]
        error = absolute_error(depth_m[counts], truth, FARTHEST_M)
        stretch = (truth / np.float32(STEP_M)).astype(np.int64)
        pixels = np.bincount(stretch, minlength=len(self._sum))
        seen = pixels > 0
        self._sum[seen] += np.bincount(stretch, error, minlength=len(self._sum))[seen] / pixels[seen]
        self._frames += seen

    def result(self) -> DistanceCurve:
        """The averages so far."""
        pairs = zip(self._sum.tolist(), self._frames.tolist(), strict=True)
        return DistanceCurve(tuple(total / frames if frames else math.nan for total, frames in pairs))
