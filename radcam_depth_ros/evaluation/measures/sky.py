"""How much of the sky is told, and how much of what stands before it is kept.

A pixel is taken for the sky as the node takes it: where the network's probability is at least `SKY_FROM`, or where the
depth is +inf already. The depth itself is measured as the network gives it, with the sky or without.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.classes import CLASS_NAMES, WIRE
from radcam_depth_ros.evaluation.measures.metrics import DepthRange, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums
from radcam_depth_ros.frame import SKY_FROM, FloatArray, ImageArray

THIN = {
    "poles": (CLASS_NAMES.index("pole"),),
    "traffic signs and lights": (CLASS_NAMES.index("traffic sign"), CLASS_NAMES.index("traffic light")),
    "wires": (WIRE,),
}
"""Thin things that may stand before the sky, by the values of class images."""


@dataclass(frozen=True)
class SkyMetrics:
    """Shares over the pixels of all frames; NaN without such pixels.

    Attributes:
        pixels: Number of pixels that are sky in the ground truth.
        finite: Share of these that have a finite depth.
        within_m: Surfaces within this range count in `kept`.
        kept: Share of the pixels with a surface that keep their depth.
        thin: The same for each of `THIN` that the drives show.
    """

    pixels: int
    finite: float
    within_m: float
    kept: float
    thin: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """Plain values: shares from 0 to 1, null where there is no number."""
        return {
            "pixels": self.pixels,
            "finite": json_number(self.finite),
            "within_m": self.within_m,
            "kept": json_number(self.kept),
            "thin_kept": {name: json_number(value) for name, value in self.thin.items()},
        }


class SkyAccumulator(Sums):
    """Sums over frames.

    Args:
        within: Which surfaces count.
    """

    SUMMED = ("_sky", "_surface", "_thin")

    def __init__(self, within: DepthRange) -> None:
        self._range = within
        self._sky, self._surface = np.zeros(2, np.int64), np.zeros(2, np.int64)
        self._thin = np.zeros((len(THIN), 2), np.int64)

    def add(
        self, depth_m: FloatArray, sky: FloatArray | None, truth_m: FloatArray, classes: ImageArray | None = None
    ) -> None:
        """Adds a frame.

        Args:
            depth_m: (H, W) float32 metres, +inf where it is the sky already.
            sky: (H, W) float32, the probability of the sky; None of a network that does not tell.
            truth_m: (H, W) float32 metres, NaN unknown, +inf sky.
            classes: (H, W) uint8 as in class images; None where the drive has none.
        """
        told = np.isinf(depth_m)
        if sky is not None:
            told |= sky >= np.float32(SKY_FROM)
        self._sky += _counts(np.isinf(truth_m), ~told)
        surface = (truth_m > self._range.lower_m) & (truth_m <= self._range.upper_m)
        self._surface += _counts(surface, ~told)
        if classes is not None:
            for sums, labels in zip(self._thin, THIN.values(), strict=True):
                sums += _counts(surface & np.isin(classes, labels), ~told)

    def result(self) -> SkyMetrics:
        """The shares so far."""
        thin = {name: _share(sums) for name, sums in zip(THIN, self._thin, strict=True) if sums[0]}
        return SkyMetrics(int(self._sky[0]), _share(self._sky), self._range.upper_m, _share(self._surface), thin)


def _counts(among: npt.NDArray[np.bool_], chosen: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """(2,): how many there are, and how many of them are chosen."""
    return np.array([among.sum(), (among & chosen).sum()], np.int64)


def _share(sums: npt.NDArray[np.int64]) -> float:
    return float(sums[1] / sums[0]) if sums[0] else math.nan
