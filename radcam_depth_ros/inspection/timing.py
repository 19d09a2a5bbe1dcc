"""Rates, gaps and offsets of stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Stamps = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Timing:
    """How regularly messages come.

    Attributes:
        hz: Messages a second; None of fewer than two, and of messages that are all of one time.
        jitter_s: Of 95 % of the intervals, how far they are from the median one at most.
        largest_gap_s: The longest interval.
        backwards: How often a message is earlier than the one before it.
    """

    hz: float | None
    jitter_s: float | None
    largest_gap_s: float | None
    backwards: int


def timing_of(times_ns: Sequence[int]) -> Timing:
    """The timing of messages in the order in which they came; intervals are those of the times in their order."""
    times = np.asarray(times_ns, np.int64)
    backwards = int((np.diff(times) < 0).sum())
    times = np.sort(times)
    if len(times) < 2 or times[0] == times[-1]:
        return Timing(None, None, None, backwards)
    intervals_s = np.diff(times) / 1e9
    jitter_s = float(np.percentile(np.abs(intervals_s - np.median(intervals_s)), 95))
    hz = (len(times) - 1) / (float(times[-1] - times[0]) / 1e9)
    return Timing(hz, jitter_s, float(intervals_s.max()), backwards)


def nearest_offsets_ns(images_ns: Sequence[int], sweeps_ns: Sequence[int]) -> Stamps:
    """Of each image, the stamp of the sweep nearest to it minus its own; the earlier one of two that are as near.

    Args:
        images_ns: Stamps of the images, in any order.
        sweeps_ns: Stamps of the sweeps, in any order; at least one.

    Returns:
        (images,) nanoseconds.
    """
    images, sweeps = np.asarray(images_ns, np.int64), np.sort(np.asarray(sweeps_ns, np.int64))
    after = np.searchsorted(sweeps, images).clip(0, len(sweeps) - 1)
    before = (after - 1).clip(0)
    to_before, to_after = sweeps[before] - images, sweeps[after] - images
    nearest: Stamps = np.where(np.abs(to_before) <= np.abs(to_after), to_before, to_after)
    return nearest
