"""Runs two configurations alternately in one process."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from radcam_depth_ros.benchmarking.accuracy import depth_difference, difference_over_drive
from radcam_depth_ros.benchmarking.figures import AgainstFigures, Description, PairFigures, SideFigures, SizeFigures
from radcam_depth_ros.benchmarking.memory import process_peak_mb
from radcam_depth_ros.benchmarking.rotation import Schedule, Task, Watch, in_rotation
from radcam_depth_ros.benchmarking.sections import count_gflop
from radcam_depth_ros.benchmarking.subject import BenchmarkError, Running, Size, Subject
from radcam_depth_ros.drive import Sample

TURN_S = 0.3
"""Each side runs for so long before it is the other's turn."""

_SUBJECT, _OTHER = "subject", "other"


@dataclass(frozen=True)
class Against:
    """What a network is held against.

    Attributes:
        spec: What was asked for, in words.
        subject: The other network and how it is run.
        image_factor: Its image has so many times the rows and columns.
        height_width: Its image's size, in place of `image_factor`.
        points: Its number of radar returns; None for the same.
        samples: Frames over which the two precisions of one network are compared as well.
    """

    spec: str
    subject: Subject
    image_factor: int = 1
    height_width: tuple[int, int] | None = None
    points: int | None = None
    samples: Iterable[Sample] | None = None

    def size(self, size: Size) -> Size:
        """What it is given where the network that is measured is given `size`."""
        height, width = self.height_width or (self.image_factor * size.height, self.image_factor * size.width)
        return Size.padded(height, width, size.points if self.points is None else self.points)


def compare(
    running: Running, own: Iterable[SizeFigures], against: Against, schedule: Schedule, watch: Watch
) -> AgainstFigures:
    """Runs two networks in turn.

    Args:
        running: The network that is measured.
        own: Its figures.
        against: What it is held against.
        schedule: How long to measure.
        watch: Is told what is going on.

    Raises:
        BenchmarkError: when there are frames to compare over, but not the same weights in two precisions.
    """
    other = Running.start(against.subject)
    if against.samples is not None and not (
        _share_weights(running, other) and running.subject.mode == other.subject.mode
    ):
        raise BenchmarkError(
            "frames of a bag are for comparing two precisions of the same weights, got a comparison of other things; "
            "give --against precision=float32, or leave the bag out"
        )
    pairs = [_compare_at(running, other, entry, against, schedule, watch) for entry in own]
    drive = None
    if against.samples is not None:
        watch("estimating the bag's frames", 0, 1)
        drive = difference_over_drive(against.samples, running.estimator(), other.estimator())
    return AgainstFigures(against.spec, Description.of(other), tuple(pairs), drive)


def _compare_at(
    running: Running, other: Running, own: SizeFigures, against: Against, schedule: Schedule, watch: Watch
) -> PairFigures:
    """Compares at one size of the network that is measured."""
    what = f"{own.size} against {against.spec}"
    watch(f"preparing {what}", 0, 1)
    size = against.size(own.size)
    inputs, call = running.prepare(own.size)
    other_inputs, other_call = other.prepare(size)
    gflop = count_gflop(other, other_inputs)
    times = in_rotation(
        [Task(_SUBJECT, call, TURN_S), Task(_OTHER, other_call, TURN_S)],
        schedule,
        running.subject.device,
        partial(watch, f"timing {what}"),
    )
    ms, other_ms = times.of(_SUBJECT), times.of(_OTHER)
    watch(f"memory of {what}", 0, 1)
    peak_mb = process_peak_mb(other.resolved, size)
    is_comparable = _share_weights(running, other) and size == own.size
    return PairFigures(
        SideFigures(own.size, float(np.median(ms)), own.whole.gflop, own.whole.peak_memory_mb),
        SideFigures(size, float(np.median(other_ms)), gflop, peak_mb),
        tuple(float(ratio) for ratio in other_ms / ms),
        float(other_ms.min() / ms.min()),
        depth_difference(running.engine, other.engine, inputs) if is_comparable else math.nan,
    )


def _share_weights(running: Running, other: Running) -> bool:
    # Random weights of one architecture are the same: they have a fixed seed.
    mine, others = running.loaded, other.loaded
    return mine.weights == others.weights and mine.archive.card == others.archive.card
