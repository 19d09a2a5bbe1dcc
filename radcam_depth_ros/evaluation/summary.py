"""The result of an evaluation, and its JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from radcam_depth_ros.drive import ScanSummary
from radcam_depth_ros.evaluation.given import Given
from radcam_depth_ros.evaluation.groups import Comparison, Grouping, worse_than_geometry
from radcam_depth_ros.evaluation.measures.distances import STEP_M, DistanceCurve
from radcam_depth_ros.evaluation.measures.edges import EdgeMetrics
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import DepthMetrics, SemiDenseMetrics, json_number
from radcam_depth_ros.evaluation.measures.reliability import Reliability
from radcam_depth_ros.evaluation.measures.sky import SkyMetrics
from radcam_depth_ros.evaluation.measures.sparsification import Sparsification
from radcam_depth_ros.evaluation.measures.things import ThingErrors, things_json


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
        distances: By distance in finer steps.
        coverage: For each of `ranges`, share of the pixels with ground truth in range whose depth is finite, averaged
            over the frames with such pixels; NaN without any.
    """

    ranges: tuple[DepthMetrics, ...]
    bins: tuple[DepthMetrics, ...]
    distances: DistanceCurve
    coverage: tuple[float, ...]

    def as_json(self) -> dict[str, object]:
        """Each range by its name, the bins, and the curve."""
        curve = {"step_m": STEP_M, "mae": self.distances.as_json()}
        return {**self.ranges_json(), "by_range": _by_name(self.bins), "by_distance": curve}

    def ranges_json(self) -> dict[str, dict[str, float | int | None]]:
        """The measures and the coverage of each range, by its name."""
        return {
            entry.name: {**entry.as_json(), "coverage": json_number(coverage)}
            for entry, coverage in zip(self.ranges, self.coverage, strict=True)
        }

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
    """Metrics over one or several drives.

    Attributes:
        network: Name of the network.
        frames: Frames of the drives.
        frames_missing: Those that have no depth.
        ground_truth: Where the ground truth is from: "exact", "lidar" or "none"; joined by "+" where frames differ.
        given: Inputs of the frames.
        dense: The dense depth.
        semi_dense: The semi-dense depth.
        baselines: Baselines on the same frames, by their names in `baselines.BASELINES`.
        by_class: The dense depth within the widest range by class, where the drives have classes.
        by_class_group: The same by group of classes.
        groupings: The dense depth and the baselines by group of frames.
        geometry: The dense depth beside geometry alone, by range; empty where that was not measured.
        sparsification: Sparsification by the confidence.
        reliability: Calibration of the confidence.
        sky: How much of the sky is told, and of what stands before it kept.
        edges: The dense depth near edges of the exact depth, and away from them.
        things: The dense depth of small things by class and distance, within 80 m and in stretches; empty where the
            drives have no classes.
        clip_m: What predictions were clipped to; None where to each range.
        latency: Of the estimate alone.
        scans: How the LiDAR scans near the frames became ground truth.
    """

    network: str
    frames: int
    frames_missing: int
    ground_truth: str
    given: Given
    dense: DepthSummary
    semi_dense: SemiDenseMetrics
    baselines: Mapping[str, DepthSummary]
    by_class: tuple[DepthMetrics, ...]
    by_class_group: tuple[DepthMetrics, ...]
    groupings: tuple[Grouping, ...]
    geometry: Mapping[str, Comparison]
    sparsification: Sparsification
    reliability: Reliability
    sky: SkyMetrics
    edges: EdgeMetrics
    things: Mapping[str, Mapping[str, ThingErrors]]
    clip_m: float | None
    latency: Latency
    scans: ScanSummary = field(default_factory=ScanSummary)

    @property
    def has_ground_truth(self) -> bool:
        """Whether anything could be measured."""
        return any(entry.frames for entry in (*self.dense.ranges, *self.dense.bins))

    def as_json(self) -> dict[str, object]:
        """Plain values for a JSON file: lengths in metres, shares from 0 to 1, null where there is no number."""
        dense = self.dense.as_json()
        worse = {"worse_than_geometry": worse_than_geometry(self.geometry, self.groupings)} if self.geometry else {}
        return {
            "network": self.network,
            "frames": self.frames,
            "frames_missing": self.frames_missing,
            "ground_truth": self.ground_truth,
            "lidar_scans": self.scans.as_json() if self.scans.scans else None,
            "given": self.given.as_json(),
            "dense": self.dense.ranges_json(),
            "semi_dense": self.semi_dense.as_json(),
            "by_range": dense["by_range"],
            "by_distance": dense["by_distance"],
            "by_class": _by_name(self.by_class),
            "by_class_group": _by_name(self.by_class_group),
            **{f"by_{grouping.name}": grouping.as_json() for grouping in self.groupings},
            **worse,
            "sparsification": self.sparsification.as_json(),
            "confidence": self.reliability.as_json(),
            "sky": self.sky.as_json() if self.sky.pixels else None,
            "edges": self.edges.as_json() if self.edges.frames else None,
            "things": things_json(self.things),
            "baselines": {name: self._baseline_json(name) for name in self.baselines},
            "clip_m": self.clip_m,
            "latency_ms": self.latency.as_json(),
        }

    def _baseline_json(self, name: str) -> dict[str, object]:
        values = self.baselines[name].as_json()
        if name == "ground_nearest":
            values["camera_height_m"] = json_number(self.given.camera_height_m)
            values["camera_height_source"] = self.given.camera_height_source
        return values


def _by_name(entries: tuple[DepthMetrics, ...]) -> dict[str, dict[str, float | int | None]]:
    return {entry.name: entry.as_json() for entry in entries}
