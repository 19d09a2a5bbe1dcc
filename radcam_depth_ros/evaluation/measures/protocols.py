"""The evaluations that papers publish on nuScenes, to the digit: which pixels count, clipping, crop and averages.

All measure MAE and RMSE of each frame and average over frames, against one LiDAR scan (`drive.published`). They differ
in little things [Singh2023, Sun2024, JustDepth2026]; `metrics` has this project's own measures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray

RANGES_M = (50.0, 70.0, 80.0)
PUBLISHED = ("mae", "rmse")


@dataclass(frozen=True)
class Protocol:
    """How one line of papers measures.

    Attributes:
        name: On the command line.
        lower_m: Truth must be farther than this.
        has_upper: Whether truth at the end of a range counts.
        clips: Whether predictions are clipped to `lower_m` and the end of the range.
        rows_off: Rows at the top of the image that are left out.
        filters_radar: Whether radar returns pass the default filters of nuScenes' devkit first.
    """

    name: str
    lower_m: float
    has_upper: bool
    clips: bool
    rows_off: int
    filters_radar: bool

    def measure(self, prediction_m: FloatArray, truth_m: FloatArray) -> npt.NDArray[np.float64]:
        """Measures one frame.

        Args:
            prediction_m: (H, W) float32 metres.
            truth_m: (H, W) float32 metres, NaN or 0 unknown.

        Returns:
            (3, 2) float64: each of `RANGES_M`, MAE and RMSE in metres; NaN where no pixel counts.

        Raises:
            EvaluationError: when the sizes differ.
        """
        if prediction_m.shape != truth_m.shape:
            raise EvaluationError(
                f"prediction and ground truth must have one size, got {prediction_m.shape} and {truth_m.shape}; "
                "resample the prediction first"
            )
        prediction, truth = prediction_m[self.rows_off :], truth_m[self.rows_off :]
        found = np.full((len(RANGES_M), len(PUBLISHED)), np.nan)
        for row, range_m in enumerate(RANGES_M):
            counts = (truth > self.lower_m) & (truth <= range_m if self.has_upper else truth < range_m)
            if not counts.any():
                continue
            given = prediction[counts].astype(np.float64)
            if self.clips:
                given = np.clip(given, self.lower_m, range_m)
            error = given - truth[counts]
            found[row] = np.abs(error).mean(), math.sqrt(np.square(error).mean())
        return found


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol("singh2023", 0.0, has_upper=False, clips=False, rows_off=0, filters_radar=False),
        Protocol("cafnet", 0.001, has_upper=False, clips=True, rows_off=4, filters_radar=False),
        Protocol("justdepth", 0.0, has_upper=True, clips=True, rows_off=4, filters_radar=True),
    )
}
"""By name."""


@dataclass(frozen=True)
class PublishedMetrics:
    """Averages over frames, in the ranges `RANGES_M`; NaN where no frame had truth.

    Attributes:
        frames: How many were averaged, by range.
        mae_m: Metres, by range.
        rmse_m: Metres, by range.
    """

    frames: tuple[int, ...]
    mae_m: tuple[float, ...]
    rmse_m: tuple[float, ...]

    def as_json(self) -> dict[str, dict[str, float | int | None]]:
        """Plain values by the range's end, null where there is no number."""
        entries = zip(RANGES_M, self.frames, self.mae_m, self.rmse_m, strict=True)
        return {
            f"{range_m:g}": {"mae": json_number(mae), "rmse": json_number(rmse), "frames": frames}
            for range_m, frames, mae, rmse in entries
        }


class PublishedMeans(Sums):
    """Averages frames."""

    SUMMED = ("_sum", "_frames")

    def __init__(self) -> None:
        self._sum = np.zeros((len(RANGES_M), len(PUBLISHED)))
        self._frames = np.zeros(len(RANGES_M), np.int64)

    def add(self, measures: npt.NDArray[np.float64]) -> None:
        """Adds a frame's measures, (3, 2) as of `Protocol.measure`; a range with NaN is left out."""
        known = np.isfinite(measures[:, 0])
        self._sum[known] += measures[known]
        self._frames += known

    def result(self) -> PublishedMetrics:
        """The averages so far."""
        with np.errstate(invalid="ignore"):
            means = self._sum / self._frames[:, None]
        mae, rmse = (tuple(column.tolist()) for column in means.T)
        return PublishedMetrics(tuple(self._frames.tolist()), mae, rmse)
