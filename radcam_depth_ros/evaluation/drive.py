"""Evaluates depth images over drives with ground truth, from a network or another source."""

from __future__ import annotations

import dataclasses
import math
import time
from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.drive import Sample, ScanSummary, ScanUse
from radcam_depth_ros.evaluation.baselines import BASELINES, ground_nearest, radar_interpolation, without_radar
from radcam_depth_ros.evaluation.given import GivenAccumulator
from radcam_depth_ros.evaluation.groups import BAG, GEOMETRY, RETURNS, SCENARIO, ComparisonMeans, GroupMeans, return_bin
from radcam_depth_ros.evaluation.measures.classes import ClassMeans
from radcam_depth_ros.evaluation.measures.distances import DistanceAccumulator
from radcam_depth_ros.evaluation.measures.edges import EdgeAccumulator
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import (
    BINS,
    RANGES,
    DepthAccumulator,
    DepthRange,
    SemiDenseAccumulator,
    finite_shares,
)
from radcam_depth_ros.evaluation.measures.reliability import ReliabilityAccumulator
from radcam_depth_ros.evaluation.measures.sky import SkyAccumulator
from radcam_depth_ros.evaluation.measures.sparsification import SparsificationAccumulator
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.evaluation.measures.things import ThingAccumulator
from radcam_depth_ros.evaluation.summary import DepthSummary, Evaluation, Latency
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame

Predict = Callable[[Frame], "DepthResult | None"]
"""Depth of a frame; None without depth, such as for a frame that a live node dropped."""


@dataclass(frozen=True)
class EvaluationSettings:
    """Settings of an evaluation.

    Attributes:
        network: Name in the result.
        camera_height_m: Height of the camera above the road, for geometry alone, where the frames do not know it; None
            for an assumed one.
        clip_m: Predictions are clipped to this instead of to each range; None for the usual protocol.
        baselines: Which of `BASELINES` are evaluated as well. `camera_only` costs a second pass of the network.
    """

    network: str = "network"
    camera_height_m: float | None = None
    clip_m: float | None = None
    baselines: tuple[str, ...] = ("ground_nearest",)

    def __post_init__(self) -> None:
        for name in ("camera_height_m", "clip_m"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise EvaluationError(f"{name} must be a positive number of metres, got {value}")
        for name in self.baselines:
            if name not in BASELINES:
                raise EvaluationError(f"a baseline must be one of {', '.join(BASELINES)}, got {name!r}")


@dataclass(frozen=True)
class Drive:
    """Frames that were recorded together.

    Attributes:
        samples: The frames with their ground truth, in order.
        name: Of the bag; empty where it does not matter.
        scenario: Properties of the whole drive: weather, time of day and so on.
    """

    samples: Iterable[Sample]
    name: str = ""
    scenario: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class FrameMeasures:
    """Metrics of one frame; NaN without ground truth.

    Attributes:
        dense: (ranges, 8) float64: each of `RANGES`, each of `MEASURES`.
        baselines: The same of each baseline, by its name.
        coverage: Share of the pixels with ground truth within the widest range that the semi-dense depth covers.
        semi_dense_mae_m: Its mean absolute error there, metres.
        returns_in_view: Number of radar returns within the image.
        latency_s: Of the estimate, seconds.
    """

    dense: npt.NDArray[np.float64]
    baselines: Mapping[str, npt.NDArray[np.float64]]
    coverage: float
    semi_dense_mae_m: float
    returns_in_view: int
    latency_s: float


@dataclass(frozen=True)
class Observation:
    """One frame of an evaluation, given to an observer.

    Attributes:
        drive: The drive it belongs to.
        index: Number of the frame within its drive, from 0.
        sample: The frame and its ground truth.
        result: Its depth, at the size of the ground truth.
        baselines: Depth of each baseline, (H, W) float32 metres, by its name.
        measures: Its metrics.
    """

    drive: Drive
    index: int
    sample: Sample
    result: DepthResult
    baselines: Mapping[str, FloatArray]
    measures: FrameMeasures

    @property
    def mae_m(self) -> float:
        """Mean absolute error of the dense depth within the widest range; NaN without ground truth."""
        return float(self.measures.dense[-1, 0])


def evaluate_drive(
    samples: Iterable[Sample],
    predict: Predict,
    settings: EvaluationSettings | None = None,
    observe: Callable[[Observation], None] | None = None,
) -> Evaluation:
    """Estimates and measures every frame of one drive; see `evaluate_drives`."""
    return evaluate_drives([Drive(samples)], predict, settings, observe)


def evaluate_drives(
    drives: Iterable[Drive],
    predict: Predict,
    settings: EvaluationSettings | None = None,
    observe: Callable[[Observation], None] | None = None,
) -> Evaluation:
    """Estimates and evaluates every frame of some drives; averages are over all frames of all drives.

    Args:
        drives: Frames with their ground truth. One frame is held at a time.
        predict: Returns the depth of a frame.
        settings: Settings of the evaluation.
        observe: Called with every frame that has depth.

    Raises:
        EvaluationError: when there are no samples, a dense depth has NaN, or a depth image cannot be the same view as
            its frame.
    """
    settings = settings or EvaluationSettings()
    sums = EvaluationSums(settings)
    for drive in drives:
        sums.join_drive(drive.name, sum_drive(drive, predict, settings, observe).plain())
    return sums.result()


def sum_drive(
    drive: Drive,
    predict: Predict,
    settings: EvaluationSettings,
    observe: Callable[[Observation], None] | None = None,
) -> EvaluationSums:
    """Estimates and sums up every frame of one drive; arguments and errors as of `evaluate_drives`."""
    sums = EvaluationSums(settings)
    for index, sample in enumerate(drive.samples):
        start = time.perf_counter()
        result = predict(sample.frame)
        latency_s = time.perf_counter() - start
        if result is None:
            sums.add_missing(sample)
            continue
        observation = sums.add(drive, index, sample, result, latency_s, predict)
        if observe is not None:
            observe(observation)
    return sums


def resize_result(result: DepthResult, frame: Frame) -> DepthResult:
    """A result at the size of its frame; each pixel takes the nearest one, so that no depth is made up.

    Raises:
        EvaluationError: when the two differ in their shape, so that they cannot be the same view.
    """
    camera = frame.camera
    if (result.camera.height, result.camera.width) == (camera.height, camera.width):
        return result
    scale_x, scale_y = result.camera.width / camera.width, result.camera.height / camera.height
    # Estimates may be at the network's size, whose pixels are square where the camera's are not quite.
    if not 0.9 < scale_x / scale_y < 1.1:
        raise EvaluationError(
            f"expected depth of a {camera.width} x {camera.height} image at that size or at one of the same shape, got "
            f"{result.camera.width} x {result.camera.height}"
        )
    images = {
        name: cv2.resize(getattr(result, name), (camera.width, camera.height), interpolation=cv2.INTER_NEAREST_EXACT)
        for name in ("dense", "semi_dense", "confidence", "sky")
        if getattr(result, name) is not None
    }
    return dataclasses.replace(result, camera=camera, **images)


def _require_no_nan(result: DepthResult, drive: Drive) -> None:
    """Refuses a dense depth that says nothing of some pixels: no measure could count them. +inf is "far away"."""
    missing = int(np.isnan(result.dense).sum())
    if missing:
        raise EvaluationError(
            f"expected a dense depth without NaN in {drive.name or 'the drive'}, got NaN in {missing} pixels at stamp "
            f"{result.stamp_ns / 1e9:.9f} s; evaluate the depth as the network gives it, before pixels are taken away"
        )


class _DepthSums(Sums):
    """Dense depth by range and by distance."""

    SUMMED = ("_ranges", "_bins", "_distances", "_coverage", "_frames")

    def __init__(self, ranges: tuple[DepthRange, ...]) -> None:
        self._ranges, self._bins = DepthAccumulator(ranges), DepthAccumulator(BINS)
        self._distances = DistanceAccumulator()
        self._coverage, self._frames = np.zeros(len(ranges)), np.zeros(len(ranges), np.int64)

    def add(self, depth_m: FloatArray, truth_m: FloatArray) -> npt.NDArray[np.float64]:
        coverage = finite_shares(depth_m, truth_m)
        self._coverage += np.nan_to_num(coverage)
        self._frames += np.isfinite(coverage)
        self._bins.add(depth_m, truth_m)
        self._distances.add(depth_m, truth_m)
        return self._ranges.add(depth_m, truth_m)

    def result(self) -> DepthSummary:
        pairs = zip(self._coverage.tolist(), self._frames.tolist(), strict=True)
        coverage = tuple(total / frames if frames else math.nan for total, frames in pairs)
        return DepthSummary(self._ranges.result(), self._bins.result(), self._distances.result(), coverage)


class EvaluationSums(Sums):
    """Sums over the frames of one or several drives.

    Args:
        settings: Settings of the evaluation.
    """

    SUMMED = (
        *("_dense", "_semi_dense", "_baselines", "_classes", "_groups", "_geometry", "_sparsification"),
        *("_reliability", "_sky", "_edges", "_things", "_given", "_frames", "_missing", "_sources", "_seconds"),
    )

    def __init__(self, settings: EvaluationSettings) -> None:
        ranges = tuple(DepthRange.within(entry.upper_m, settings.clip_m) for entry in RANGES)
        self._settings = settings
        self._dense, self._semi_dense = _DepthSums(ranges), SemiDenseAccumulator(ranges)
        self._baselines = {name: _DepthSums(ranges) for name in settings.baselines}
        self._classes, self._groups, self._geometry = ClassMeans(ranges[-1]), GroupMeans(), ComparisonMeans()
        self._sparsification, self._reliability = (
            SparsificationAccumulator(ranges[-1]),
            ReliabilityAccumulator(ranges[-1]),
        )
        self._sky = SkyAccumulator(ranges[-1])
        self._edges, self._things = EdgeAccumulator(ranges), ThingAccumulator(ranges[-1].clip_m)
        self._given = GivenAccumulator(settings.camera_height_m)
        self._frames = self._missing = 0
        self._sources: set[str] = set()
        self._seconds = array("d")
        self._uses: list[ScanUse] = []
        self._joined_scans = ScanSummary()

    @property
    def _scans(self) -> ScanSummary:
        """Of all frames."""
        return ScanSummary.joined([self._joined_scans, ScanSummary.of(self._uses)])

    def plain(self) -> dict[str, Any]:
        """The sums as JSON can hold them, to the last digit; scans as well."""
        return {**super().plain(), "scans": dataclasses.asdict(self._scans)}

    def join_drive(self, name: str, plain: Mapping[str, Any]) -> None:
        """Adds the sums of one drive.

        Args:
            name: What its frames are filed under; empty where they are under none.
            plain: What `plain` gave of the sums of `sum_drive`.

        Raises:
            EvaluationError: when they are of another kind.
        """
        groups = plain["groups"]["groups"]
        if BAG in groups:
            (frames,) = groups[BAG].values()
            groups = {**groups, BAG: {name: frames}}
        self.join({**plain, "groups": {"groups": groups}})
        self._joined_scans = ScanSummary.joined([self._joined_scans, ScanSummary.from_mapping(plain["scans"])])

    def add_missing(self, sample: Sample) -> None:
        """Adds a frame that has no depth."""
        self._look_at(sample)
        self._missing += 1

    def add(
        self, drive: Drive, index: int, sample: Sample, result: DepthResult, latency_s: float, predict: Predict
    ) -> Observation:
        """Adds a frame with its depth; `predict` serves the baseline without radar."""
        in_view = self._look_at(sample)
        _require_no_nan(result, drive)
        result, truth_m = resize_result(result, sample.frame), sample.depth_m
        depths = {name: self._baseline(name, drive, sample.frame, predict) for name in self._baselines}
        coverage, semi_dense_mae_m = self._semi_dense.add(result.semi_dense, truth_m)
        measures = FrameMeasures(
            self._dense.add(result.dense, truth_m),
            {name: self._baselines[name].add(depth_m, truth_m) for name, depth_m in depths.items()},
            coverage,
            semi_dense_mae_m,
            in_view,
            latency_s,
        )
        self._sparsification.add(result.dense, result.confidence, truth_m)
        self._sky.add(result.dense, result.sky, truth_m, sample.classes)
        time_of_day = drive.scenario.get("time_of_day", "")
        self._reliability.add(result.dense, result.confidence, truth_m, sample.classes, time_of_day)
        if sample.classes is not None:
            self._classes.add(result.dense, truth_m, sample.classes)
            self._things.add(result.dense, truth_m, sample.classes)
        # Points of a LiDAR are too sparse to have neighbours.
        if sample.source == "exact":
            self._edges.add(result.dense, truth_m)
        self._seconds.append(latency_s)
        properties = {RETURNS: return_bin(in_view)}
        properties |= {name: drive.scenario[name] for name in SCENARIO if name in drive.scenario}
        properties |= {BAG: drive.name} if drive.name else {}
        self._groups.add(properties, measures.dense, measures.baselines)
        if GEOMETRY in measures.baselines:
            self._geometry.add(measures.dense, measures.baselines[GEOMETRY])
        return Observation(drive, index, sample, result, depths, measures)

    def _look_at(self, sample: Sample) -> int:
        self._frames += 1
        self._sources.add(sample.source)
        if sample.scan is not None:
            self._uses.append(sample.scan)
        return self._given.add(sample.frame)

    def _baseline(self, name: str, drive: Drive, frame: Frame, predict: Predict) -> FloatArray:
        if name == "ground_nearest":
            return ground_nearest(frame, self._settings.camera_height_m)
        if name == "radar_interpolation":
            return radar_interpolation(frame)
        result = predict(without_radar(frame))
        if result is None:
            raise EvaluationError(
                "expected depth of a frame without radar for the baseline camera_only, got none; leave it out where "
                "depth is not estimated but read"
            )
        _require_no_nan(result, drive)
        return resize_result(result, frame).dense

    def result(self) -> Evaluation:
        """The measures so far; EvaluationError where there are no frames."""
        if not self._frames:
            raise EvaluationError(
                "expected a drive with at least one image that goes with its radar sweeps, got none; check its topics "
                "and stamps"
            )
        by_class, by_class_group = self._classes.result()
        return Evaluation(
            network=self._settings.network,
            frames=self._frames,
            frames_missing=self._missing,
            ground_truth="+".join(sorted(self._sources)),
            given=self._given.result(),
            dense=self._dense.result(),
            semi_dense=self._semi_dense.result(),
            baselines={name: sums.result() for name, sums in self._baselines.items()},
            by_class=by_class,
            by_class_group=by_class_group,
            groupings=self._groups.result(),
            geometry=self._geometry.result() if GEOMETRY in self._baselines else {},
            sparsification=self._sparsification.result(),
            reliability=self._reliability.result(),
            sky=self._sky.result(),
            edges=self._edges.result(),
            things=self._things.result(),
            clip_m=self._settings.clip_m,
            latency=Latency.of(self._seconds),
            scans=self._scans,
        )
