"""Metrics of the dense depth by class, and by group of classes."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.classes import CLASS_GROUPS, CLASS_NAMES
from radcam_depth_ros.evaluation.measures.metrics import DepthMetrics, DepthRange, FrameMean, measure_labels
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray, ImageArray


class ClassMeans(Sums):
    """Averages over frames by class, and by group of classes.

    Args:
        widest: Which ground truth counts.
    """

    SUMMED = ("_sets",)

    def __init__(self, widest: DepthRange) -> None:
        self._range = widest
        self._sets = (
            _LabelMeans(CLASS_NAMES, {name: (name,) for name in CLASS_NAMES}),
            _LabelMeans(CLASS_NAMES, CLASS_GROUPS),
        )

    def add(self, depth_m: FloatArray, truth_m: FloatArray, classes: ImageArray) -> None:
        """Adds a frame; all (H, W), classes as Cityscapes' training ids, 255 unknown."""
        counts = (truth_m > self._range.lower_m) & (truth_m <= self._range.upper_m) & (classes < len(CLASS_NAMES))
        depth, truth, shown = depth_m[counts], truth_m[counts], classes[counts]
        for entry in self._sets:
            entry.add(depth, truth, shown, self._range.clip_m)

    def result(self) -> tuple[tuple[DepthMetrics, ...], tuple[DepthMetrics, ...]]:
        """By class, and by group of classes; those without any ground truth, the sky above all, are left out."""
        by_class, by_group = (entry.result() for entry in self._sets)
        return by_class, by_group


class _LabelMeans(Sums):
    """Averages over frames by groups of labels."""

    SUMMED = ("_means",)

    def __init__(self, labels: tuple[str, ...], groups: dict[str, tuple[str, ...]]) -> None:
        self._means = tuple(FrameMean(name) for name in groups)
        self._group_of = np.zeros(len(labels), np.int64)
        for index, members in enumerate(groups.values()):
            self._group_of[[labels.index(member) for member in members]] = index

    def add(self, depth_m: FloatArray, truth_m: FloatArray, labels: ImageArray, clip_m: float) -> None:
        rows = measure_labels(depth_m, truth_m, self._group_of[labels], len(self._means), clip_m)
        for mean, row in zip(self._means, rows, strict=True):
            mean.add(row)

    def result(self) -> tuple[DepthMetrics, ...]:
        entries = (mean.result() for mean in self._means)
        return tuple(entry for entry in entries if entry.frames)
