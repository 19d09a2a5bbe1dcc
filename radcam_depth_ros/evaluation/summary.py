"""What an evaluation gives: values to print, to write as JSON and to compare."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.evaluation.metrics import DepthMetrics, EvaluationError, SemiDenseMetrics, json_number


@dataclass(frozen=True)
class Latency:
    """How long an estimate took, in milliseconds; NaN without frames."""

    p50_ms: float = math.nan
    p99_ms: float = math.nan

    @classmethod
    def of(cls, seconds: Iterable[float]) -> Latency:
        """Percentiles of durations; the first, which pays for what is built once, is left out where there are more."""
        durations = list(seconds)
        if not durations:
            return cls()
        p50, p99 = np.percentile(durations[1:] or durations, (50, 99)) * 1000
        return cls(float(p50), float(p99))

    def as_json(self) -> dict[str, float | int | None]:
        """Plain values, null where there is no number."""
        return {"p50": json_number(self.p50_ms), "p99": json_number(self.p99_ms)}


@dataclass(frozen=True)
class DepthSummary:
    """Measures of one kind of dense depth over a drive.

    Attributes:
        ranges: Within 50, 70 and 80 m.
        bins: By distance.
    """

    ranges: tuple[DepthMetrics, ...]
    bins: tuple[DepthMetrics, ...]

    def within(self, range_m: float) -> DepthMetrics:
        """The measures within a range.

        Raises:
            EvaluationError: when that range was not measured.
        """
        for entry in self.ranges:
            if entry.name == f"{range_m:g}":
                return entry
        measured = ", ".join(entry.name for entry in self.ranges)
        raise EvaluationError(f"expected one of the ranges that were measured, {measured} m, got {range_m:g} m")


@dataclass(frozen=True)
class Evaluation:
    """What was measured over a drive.

    Attributes:
        network: What gave the depth.
        frames: Frames of the drive.
        frames_missing: Those that have no depth.
        ground_truth: Where the ground truth is from: "exact", "lidar" or "none"; joined by "+" where frames differ.
        dense: The dense depth.
        semi_dense: The semi-dense depth.
        by_class: The dense depth within the widest range by what a pixel shows, where the drive knows.
        ground_nearest: Geometry alone, on the same frames.
        camera_height_m: The height that geometry alone was given; NaN without frames.
        camera_height_source: "frame" (the drive's transforms, or the configuration), "given" or "assumed".
        clip_m: What predictions were clipped to; None where to each range.
        latency: Of the estimate alone.
    """

    network: str
    frames: int
    frames_missing: int
    ground_truth: str
    dense: DepthSummary
    semi_dense: SemiDenseMetrics
    by_class: tuple[DepthMetrics, ...]
    ground_nearest: DepthSummary
    camera_height_m: float
    camera_height_source: str
    clip_m: float | None
    latency: Latency

    @property
    def has_ground_truth(self) -> bool:
        """Whether anything could be measured."""
        return any(entry.frames for entry in (*self.dense.ranges, *self.dense.bins))

    def as_json(self) -> dict[str, object]:
        """Plain values for a JSON file: lengths in metres, shares from 0 to 1, null where there is no number."""
        return {
            "network": self.network,
            "frames": self.frames,
            "frames_missing": self.frames_missing,
            "ground_truth": self.ground_truth,
            "dense": _by_name(self.dense.ranges),
            "semi_dense": self.semi_dense.as_json(),
            "by_range": _by_name(self.dense.bins),
            "by_class": _by_name(self.by_class),
            "baselines": {
                "ground_nearest": {
                    **_by_name(self.ground_nearest.ranges),
                    "by_range": _by_name(self.ground_nearest.bins),
                    "camera_height_m": json_number(self.camera_height_m),
                    "camera_height_source": self.camera_height_source,
                }
            },
            "clip_m": self.clip_m,
            "latency_ms": self.latency.as_json(),
        }


def _by_name(entries: tuple[DepthMetrics, ...]) -> dict[str, dict[str, float | int | None]]:
    return {entry.name: entry.as_json() for entry in entries}
