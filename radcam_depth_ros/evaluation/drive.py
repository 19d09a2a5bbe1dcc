"""Measures a network, or anything else that gives depth images, over a drive with ground truth."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from radcam_depth_ros.drive import Sample
from radcam_depth_ros.evaluation.baselines import ground_nearest, known_or_assumed_ground
from radcam_depth_ros.evaluation.metrics import (
    BINS,
    RANGES,
    DepthAccumulator,
    DepthMetrics,
    DepthRange,
    EvaluationError,
    SemiDenseAccumulator,
)
from radcam_depth_ros.evaluation.summary import DepthSummary, Evaluation, Latency
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame, ImageArray

Predict = Callable[[Frame], "DepthResult | None"]
"""Gives a frame's depth; None where there is none, of a frame that a live node dropped for example."""

CLASS_NAMES = (
    *(
        "road",
        "sidewalk",
        "building",
        "wall",
        "fence",
        "pole",
        "traffic light",
        "traffic sign",
        "vegetation",
        "terrain",
    ),
    *("sky", "person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
)
"""The 19 classes of Cityscapes in the order of their training ids."""


@dataclass(frozen=True)
class EvaluationSettings:
    """How to measure.

    Attributes:
        network: What the result is filed under.
        camera_height_m: Height of the camera above the road, for geometry alone, where the frames do not know it; None
            for an assumed one.
        clip_m: Predictions are clipped to this instead of to each range; None for the usual protocol.
    """

    network: str = "network"
    camera_height_m: float | None = None
    clip_m: float | None = None

    def __post_init__(self) -> None:
        for name in ("camera_height_m", "clip_m"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise EvaluationError(f"{name} must be a positive number of metres, got {value}")


@dataclass(frozen=True)
class Observation:
    """One frame of an evaluation, for whoever wants to look on.

    Attributes:
        index: Number of the frame, from 0.
        sample: The frame and its ground truth.
        result: Its depth, at the size of the ground truth.
        geometry_m: Depth from geometry alone, (H, W) float32 metres.
        mae_m: Mean absolute error of the dense depth within the widest range; NaN without ground truth.
    """

    index: int
    sample: Sample
    result: DepthResult
    geometry_m: FloatArray
    mae_m: float


def evaluate_drive(
    samples: Iterable[Sample],
    predict: Predict,
    settings: EvaluationSettings | None = None,
    observe: Callable[[Observation], None] | None = None,
) -> Evaluation:
    """Estimates and measures every frame of a drive.

    Args:
        samples: Frames with their ground truth.
        predict: Gives the depth of a frame.
        settings: How to measure.
        observe: Is shown every frame that has depth.

    Raises:
        EvaluationError: when there are no samples, or a depth image cannot be the same view as its frame.
    """
    drive, seconds = _Drive(settings or EvaluationSettings()), []
    for sample in samples:
        start = time.perf_counter()
        result = predict(sample.frame)
        if result is not None:
            seconds.append(time.perf_counter() - start)
        observation = drive.add(sample, result)
        if observe is not None and observation is not None:
            observe(observation)
    return drive.result(Latency.of(seconds))


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
        for name in ("dense", "semi_dense", "confidence")
    }
    return dataclasses.replace(result, camera=camera, **images)


class _DepthSums:
    """Dense depth by range and by distance."""

    def __init__(self, ranges: tuple[DepthRange, ...]) -> None:
        self._ranges, self._bins = DepthAccumulator(ranges), DepthAccumulator(BINS)

    def add(self, depth_m: FloatArray, truth_m: FloatArray) -> float:
        self._bins.add(depth_m, truth_m)
        return float(self._ranges.add(depth_m, truth_m)[-1, 0])

    def result(self) -> DepthSummary:
        return DepthSummary(self._ranges.result(), self._bins.result())


class _ClassSums:
    """Dense depth by what a pixel shows."""

    def __init__(self, widest: DepthRange) -> None:
        self._sums = {name: DepthAccumulator([dataclasses.replace(widest, name=name)]) for name in CLASS_NAMES}

    def add(self, depth_m: FloatArray, truth_m: FloatArray, classes: ImageArray) -> None:
        for number in np.flatnonzero(np.bincount(classes.ravel(), minlength=256)[: len(CLASS_NAMES)]):
            shows = classes == number
            self._sums[CLASS_NAMES[number]].add(depth_m[shows], truth_m[shows])

    def result(self) -> tuple[DepthMetrics, ...]:
        """Classes without any ground truth, the sky above all, are left out."""
        entries = [sums.result()[0] for sums in self._sums.values()]
        return tuple(entry for entry in entries if entry.frames)


class _Drive:
    """Sums over the frames of a drive."""

    def __init__(self, settings: EvaluationSettings) -> None:
        clip_m = settings.clip_m
        ranges = tuple(DepthRange.within(entry.upper_m, clip_m) for entry in RANGES)
        self._settings = settings
        self._dense, self._geometry = _DepthSums(ranges), _DepthSums(ranges)
        self._semi_dense, self._classes = SemiDenseAccumulator(ranges), _ClassSums(ranges[-1])
        self._frames, self._missing = 0, 0
        self._sources: set[str] = set()
        self._height_m, self._height_source = math.nan, "assumed"

    def add(self, sample: Sample, result: DepthResult | None) -> Observation | None:
        index = self._frames
        self._frames += 1
        self._sources.add(sample.source)
        self._remember_height(sample.frame)
        if result is None:
            self._missing += 1
            return None
        result, truth_m = resize_result(result, sample.frame), sample.depth_m
        geometry_m = ground_nearest(sample.frame, self._settings.camera_height_m)
        mae_m = self._dense.add(result.dense, truth_m)
        self._geometry.add(geometry_m, truth_m)
        self._semi_dense.add(result.semi_dense, truth_m)
        if sample.classes is not None:
            self._classes.add(result.dense, truth_m, sample.classes)
        return Observation(index, sample, result, geometry_m, mae_m)

    def _remember_height(self, frame: Frame) -> None:
        given_m = self._settings.camera_height_m
        self._height_m = known_or_assumed_ground(frame, given_m).height_m
        if given_m is not None and math.isclose(given_m, self._height_m):
            self._height_source = "given"
        else:
            self._height_source = "frame" if frame.ground.is_known else "assumed"

    def result(self, latency: Latency) -> Evaluation:
        if not self._frames:
            raise EvaluationError(
                "expected a drive with at least one image that goes with its radar sweeps, got none; check its topics "
                "and stamps"
            )
        return Evaluation(
            network=self._settings.network,
            frames=self._frames,
            frames_missing=self._missing,
            ground_truth="+".join(sorted(self._sources)),
            dense=self._dense.result(),
            semi_dense=self._semi_dense.result(),
            by_class=self._classes.result(),
            ground_nearest=self._geometry.result(),
            camera_height_m=self._height_m,
            camera_height_source=self._height_source,
            clip_m=self._settings.clip_m,
            latency=latency,
        )
