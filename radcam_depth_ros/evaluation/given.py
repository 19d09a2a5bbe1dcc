"""Inputs of a network over a drive: image sizes, radar returns, the road."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from radcam_depth_ros.evaluation.baselines import known_or_assumed_ground
from radcam_depth_ros.evaluation.measures.metrics import json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.geometry import project


def returns_in_view(frame: Frame) -> int:
    """The number of radar returns that lie within the image."""
    uv, depth_m = project(frame.radar.xyz_m, frame.camera)
    with np.errstate(invalid="ignore"):
        inside = (depth_m > 0) & (uv >= -0.5).all(axis=1)
        inside &= (uv[:, 0] < frame.camera.width - 0.5) & (uv[:, 1] < frame.camera.height - 0.5)
    return int(inside.sum())


@dataclass(frozen=True)
class Given:
    """Inputs of the frames of a drive.

    Attributes:
        image_sizes: As "1600 x 900", each once.
        returns_in_view: Least, middle and greatest number of radar returns within an image; NaN without frames.
        rcs_share: Share of all returns with a radar cross section; NaN without returns.
        speed_share: The same of the radial speed.
        road_share: Share of the frames whose road, the camera's height above it included, the network was told.
        camera_height_m: The heights that geometry alone was given, averaged over the frames; NaN without frames.
        camera_height_source: "frame" (the drive's transforms, or the configuration), "given" or "assumed"; joined by
            "+" where frames differ.
    """

    image_sizes: tuple[str, ...]
    returns_in_view: tuple[float, float, float]
    rcs_share: float
    speed_share: float
    road_share: float
    camera_height_m: float
    camera_height_source: str

    def as_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "image_sizes": list(self.image_sizes),
            "returns_in_view": dict(
                zip(("min", "median", "max"), map(json_number, self.returns_in_view), strict=True),
            ),
            "rcs_share": json_number(self.rcs_share),
            "speed_share": json_number(self.speed_share),
            "road_share": json_number(self.road_share),
        }


class GivenAccumulator(Sums):
    """Summarises the inputs of the frames of a drive.

    Args:
        camera_height_m: The height that geometry alone is given where a frame does not know it; None for an assumed
            one.
    """

    SUMMED = ("_sizes", "_in_view", "_height_m", "_sources", "_returns", "_with_rcs", "_with_speed", "_with_road")

    def __init__(self, camera_height_m: float | None) -> None:
        self._given_m = camera_height_m
        self._sizes: Counter[str] = Counter()
        self._in_view: Counter[int] = Counter()
        self._height_m = Fraction(0)  # an exact sum does not depend on the order
        self._sources: set[str] = set()
        self._returns = self._with_rcs = self._with_speed = self._with_road = 0

    def add(self, frame: Frame) -> int:
        """Adds a frame; gives back the number of its radar returns in view."""
        self._sizes[f"{frame.camera.width} x {frame.camera.height}"] += 1
        in_view = returns_in_view(frame)
        self._in_view[in_view] += 1
        self._returns += len(frame.radar)
        self._with_rcs += int(np.isfinite(frame.radar.rcs_dbsm).sum())
        self._with_speed += int(np.isfinite(frame.radar.radial_speed_mps).sum())
        self._with_road += frame.ground.is_known
        height_m = known_or_assumed_ground(frame, self._given_m).height_m
        self._height_m += Fraction(height_m)
        is_given = self._given_m is not None and math.isclose(self._given_m, height_m)
        self._sources.add("given" if is_given else "frame" if frame.ground.is_known else "assumed")
        return in_view

    def result(self) -> Given:
        """The summary so far."""
        frames = self._in_view.total()
        return Given(
            tuple(self._sizes),
            _spread(self._in_view),
            self._with_rcs / self._returns if self._returns else math.nan,
            self._with_speed / self._returns if self._returns else math.nan,
            self._with_road / frames if frames else math.nan,
            float(self._height_m / frames) if frames else math.nan,
            "+".join(sorted(self._sources)),
        )


def _spread(frames: Counter[int]) -> tuple[float, float, float]:
    counts = list(frames.elements())
    if not counts:
        return math.nan, math.nan, math.nan
    return min(counts), statistics.median(counts), max(counts)
