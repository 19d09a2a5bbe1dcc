"""Metrics by group of frames: by weather, time of day, number of returns, or bag."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.metrics import DepthMetrics, FrameMean

RETURNS, BAG = "returns", "bag"
SCENARIO = ("weather", "time_of_day", "season", "street")
"""Properties of a drive's scenario that frames are grouped by."""
_RETURN_BOUNDS = (0, 10, 50, 200, 1000)
RETURN_BINS = ("0", "1-10", "11-50", "51-200", "201-1000", ">1000")
"""Numbers of radar returns in view."""


def return_bin(count: int) -> str:
    """Which of `RETURN_BINS` a number of returns belongs to."""
    return RETURN_BINS[bisect_left(_RETURN_BOUNDS, count)]


@dataclass(frozen=True)
class Group:
    """Frames that share a property.

    Attributes:
        name: The value of the property: "rain", "11-50".
        dense: The dense depth within the widest range.
        baselines: The same of each baseline, by its name.
    """

    name: str
    dense: DepthMetrics
    baselines: Mapping[str, DepthMetrics]

    def as_json(self) -> dict[str, object]:
        """The dense depth's measures, and those of each baseline."""
        return {**self.dense.as_json(), "baselines": {name: entry.as_json() for name, entry in self.baselines.items()}}


@dataclass(frozen=True)
class Grouping:
    """All frames that were measured, by one of their properties.

    Attributes:
        name: The property: one of `SCENARIO`, `RETURNS`, `BAG`.
        groups: Returns by their number, all else in the order in which it came.
    """

    name: str
    groups: tuple[Group, ...]

    def as_json(self) -> dict[str, object]:
        """Each group by its name."""
        return {group.name: group.as_json() for group in self.groups}


class GroupMeans:
    """Averages over the frames of each group."""

    def __init__(self) -> None:
        self._means: dict[str, dict[str, dict[str, FrameMean]]] = {}

    def add(
        self,
        properties: Mapping[str, str],
        dense: npt.NDArray[np.float64],
        baselines: Mapping[str, npt.NDArray[np.float64]],
    ) -> None:
        """Adds a frame.

        Args:
            properties: What the frame is grouped by: the name of each property and its value.
            dense: The frame's measures, (8,) in the order of `MEASURES`.
            baselines: The same of each baseline, by its name.
        """
        for name, value in properties.items():
            means = self._means.setdefault(name, {}).setdefault(value, {})
            for kind, measures in (("", dense), *baselines.items()):
                means.setdefault(kind, FrameMean(value)).add(measures)

    def result(self) -> tuple[Grouping, ...]:
        """The averages so far."""
        return tuple(Grouping(name, tuple(self._groups(name))) for name in self._means)

    def _groups(self, name: str) -> list[Group]:
        means = self._means[name]
        values = [value for value in RETURN_BINS if value in means] if name == RETURNS else list(means)
        groups = []
        for value in values:
            entries = {kind: mean.result() for kind, mean in means[value].items()}
            groups.append(Group(value, entries.pop(""), entries))
        return groups
