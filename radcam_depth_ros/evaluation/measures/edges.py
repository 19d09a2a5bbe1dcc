"""Metrics of the dense depth near edges of the exact depth, and away from them.

An edge lies between two pixels, side by side or one above the other, whose depths differ by more than a ratio, or of
which one is sky. Pixels of unknown depth make no edge. Rows of a flat road close below the horizon differ that
much, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.measures.metrics import RANGES, DepthAccumulator, DepthMetrics, DepthRange, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import FloatArray, ImageArray

EDGE_RATIO = 1.15
"""Neighbouring pixels have an edge between them where the larger depth is more than this many times the smaller."""
NEAR_PX = 8
"""Pixels are near an edge within this distance from a pixel beside it, in pixels of the image that is evaluated."""


@dataclass(frozen=True)
class EdgeMetrics:
    """Measures near edges and away from them, over the frames with exact depth.

    Attributes:
        frames: Frames with exact depth.
        share: Share of the pixels with ground truth within the widest range that are near an edge, averaged over the
            frames with such pixels; NaN without any.
        near: Of the pixels near an edge, one for each range.
        away: Of all others.
    """

    frames: int
    share: float
    near: tuple[DepthMetrics, ...]
    away: tuple[DepthMetrics, ...]

    def as_json(self) -> dict[str, object]:
        """Plain values: near edges each range by its name, the share, and away from edges each range by its name."""
        near, away = ({entry.name: entry.as_json() for entry in entries} for entries in (self.near, self.away))
        return {**near, "share": json_number(self.share), "away": away}


class EdgeAccumulator(Sums):
    """Averages measures near edges and away from them over frames.

    Args:
        ranges: The ranges, the widest last.
    """

    SUMMED = ("_near", "_away", "_share", "_frames", "_frames_with_truth")

    def __init__(self, ranges: Sequence[DepthRange] = RANGES) -> None:
        self._widest = ranges[-1]
        self._near, self._away = DepthAccumulator(ranges), DepthAccumulator(ranges)
        self._share = 0.0
        self._frames = self._frames_with_truth = 0

    def add(self, depth_m: FloatArray, truth_m: FloatArray) -> None:
        """Adds a frame.

        Args:
            depth_m: (H, W) float32 metres.
            truth_m: (H, W) float32 metres, exact depth: NaN unknown, +inf sky.

        Raises:
            EvaluationError: when the sizes differ.
        """
        self._frames += 1
        # Both as images: a wrong size is refused as everywhere, before pixels are chosen.
        unknown = np.float32(np.nan)
        near = near_edges(truth_m)
        self._near.add(depth_m, np.where(near, truth_m, unknown))
        self._away.add(depth_m, np.where(near, unknown, truth_m))
        inside = (truth_m > self._widest.lower_m) & (truth_m <= self._widest.upper_m)
        if inside.any():
            self._share += float(near[inside].mean())
            self._frames_with_truth += 1

    def result(self) -> EdgeMetrics:
        """The averages so far."""
        share = self._share / self._frames_with_truth if self._frames_with_truth else math.nan
        return EdgeMetrics(self._frames, share, self._near.result(), self._away.result())


def near_edges(truth_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Which pixels are within `NEAR_PX` of a pixel beside an edge.

    Args:
        truth_m: (H, W) float32 metres, positive; NaN unknown, +inf sky.

    Returns:
        (H, W) bool.
    """
    beside = np.zeros(truth_m.shape, np.uint8)
    # Views: what is marked in them is marked in the image.
    _mark_steps(truth_m[:, :-1], truth_m[:, 1:], beside[:, :-1], beside[:, 1:])
    _mark_steps(truth_m[:-1], truth_m[1:], beside[:-1], beside[1:])
    from_middle = np.square(np.arange(-NEAR_PX, NEAR_PX + 1))
    disc = (from_middle[:, None] + from_middle <= NEAR_PX**2).astype(np.uint8)
    near: npt.NDArray[np.bool_] = cv2.dilate(beside, disc).view(np.bool_)
    return near


def _mark_steps(first_m: FloatArray, second_m: FloatArray, first: ImageArray, second: ImageArray) -> None:
    """Sets 1 in `first` and `second` where the depths of the two have an edge between them."""
    # NaN stays NaN and compares as false, as do two pixels of sky; one pixel of sky is farther than any surface.
    step = np.maximum(first_m, second_m) > np.float32(EDGE_RATIO) * np.minimum(first_m, second_m)
    first |= step
    second |= step
