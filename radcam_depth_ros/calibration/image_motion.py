"""Yaw rate of the camera from the motion of image points."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from radcam_depth_ros.calibration.signals import Signal
from radcam_depth_ros.frame import Frame

_WIDTH = 320
_LONGEST_S = 0.35
"""Between images that are further apart nothing can be followed."""
_POINTS = 150
_FEWEST = 12


class ImageMotion:
    """Follows points from image to image: how fast the camera turns."""

    def __init__(self) -> None:
        self._before: tuple[int, Any] | None = None
        self._times_s: list[float] = []
        self._yaw_rates: list[float] = []

    @property
    def yaw_rate(self) -> Signal:
        """rad/s to the left."""
        return Signal.of(self._times_s, self._yaw_rates)

    def add(self, frame: Frame) -> None:
        """Takes the next image."""
        scale = min(1.0, _WIDTH / frame.camera.width)
        size = (round(frame.camera.width * scale), max(1, round(frame.camera.height * scale)))
        grey = cv2.cvtColor(cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        before, self._before = self._before, (frame.stamp_ns, grey)
        if before is None or not 0 < (frame.stamp_ns - before[0]) / 1e9 <= _LONGEST_S:
            return
        start, moved = _follow(before[1], grey)
        if len(start) < _FEWEST:
            return
        elapsed_s = (frame.stamp_ns - before[0]) / 1e9
        columns = start[:, 0] / scale - frame.camera.cx
        on_left = columns < 0
        if min(on_left.sum(), (~on_left).sum()) < _FEWEST // 2:
            return
        # Driving ahead moves both halves apart, turning moves them alike.
        moved_px = np.mean([np.median(moved[half, 0]) for half in (on_left, ~on_left)]) / scale
        self._times_s.append((frame.stamp_ns + before[0]) / 2e9)
        self._yaw_rates.append(float(moved_px) / frame.camera.fx / elapsed_s)


def _follow(before: Any, after: Any) -> tuple[Any, Any]:
    """Points (n, 2) of an image and how far they moved to the next, pixels."""
    points = cv2.goodFeaturesToTrack(before, _POINTS, 0.01, 6)
    if points is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, points, np.zeros_like(points))
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, np.zeros_like(points))
    good = (found[:, 0] == 1) & (found_back[:, 0] == 1) & (np.abs(back - points).max(axis=(1, 2)) < 0.5)
    return points[good, 0].astype(np.float64), (there - points)[good, 0].astype(np.float64)
