"""Metrics by group of frames (weather, time of day, number of returns, bag), and comparison with geometry alone."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.evaluation.measures.metrics import MEASURES, RANGES, DepthMetrics, FrameMean, json_number
from radcam_depth_ros.evaluation.measures.sums import Sums

RETURNS, BAG = "returns", "bag"
SCENARIO = ("weather", "time_of_day", "season", "street")
"""Properties of a drive's scenario that frames are grouped by."""
_RETURN_BOUNDS = (0, 10, 50, 200, 1000)
RETURN_BINS = ("0", "1-10", "11-50", "51-200", "201-1000", ">1000")
"""Numbers of radar returns in view."""


def return_bin(count: int) -> str:
    """Which of `RETURN_BINS` a number of returns belongs to."""
    return RETURN_BINS[bisect_left(_RETURN_BOUNDS, count)]


GEOMETRY = "ground_nearest"
"""The baseline that the dense depth is compared with."""
COMPARED = {entry.name: index for index, entry in enumerate(RANGES) if entry.upper_m in (50.0, 80.0)}
"""Ranges in which the two are compared, and their rows among `RANGES`."""
MARGIN = 0.05
"""A frame counts as worse than geometry alone where its MAE is larger by more than this share."""
_MAE = MEASURES.index("mae")


@dataclass(frozen=True)
class Comparison:
    """MAE of the dense depth and of geometry alone (`ground_nearest`) within one range; NaN without frames.

    Attributes:
        frames: Frames with ground truth in range.
        mae_m: Mean absolute error of the dense depth, averaged over these frames, metres.
        geometry_mae_m: The same of geometry alone.
        frames_share: Share of these frames whose MAE is more than `MARGIN` above that of geometry alone.
    """

    frames: int
    mae_m: float
    geometry_mae_m: float
    frames_share: float

    @property
    def is_worse(self) -> bool:
        """Whether the dense depth's MAE is larger than that of geometry alone."""
        return self.mae_m > self.geometry_mae_m


class ComparisonMeans(Sums):
    """Compares the dense depth with geometry alone over frames."""

    SUMMED = ("_sum", "_frames", "_worse")

    def __init__(self) -> None:
        self._sum = np.zeros((len(COMPARED), 2))
        self._frames, self._worse = np.zeros(len(COMPARED), np.int64), np.zeros(len(COMPARED), np.int64)

    def add(self, dense: npt.NDArray[np.float64], geometry: npt.NDArray[np.float64]) -> None:
        """Adds a frame's measures, each (ranges, 8); a range with NaN has no ground truth and is left out."""
        rows = list(COMPARED.values())
        pairs = np.stack([dense[rows, _MAE], geometry[rows, _MAE]], axis=1)
        known = np.isfinite(pairs).all(axis=1)
        self._sum[known] += pairs[known]
        self._frames += known
        self._worse += known & (pairs[:, 0] > (1.0 + MARGIN) * pairs[:, 1])

    def result(self) -> dict[str, Comparison]:
        """The comparison so far, by the name of the range."""
        with np.errstate(invalid="ignore"):
            rows = np.column_stack([self._sum, self._worse]) / self._frames[:, None]
        counts = self._frames.tolist()
        return {name: Comparison(counts[index], *rows[index].tolist()) for index, name in enumerate(COMPARED)}


@dataclass(frozen=True)
class Group:
    """Frames that share a property.

    Attributes:
        name: The value of the property: "rain", "11-50".
        dense: The dense depth within the widest range.
        baselines: The same of each baseline, by its name.
        comparisons: The dense depth beside geometry alone, by range; empty where that was not measured.
    """

    name: str
    dense: DepthMetrics
    baselines: Mapping[str, DepthMetrics]
    comparisons: Mapping[str, Comparison] = field(default_factory=dict)

    @property
    def worse_within(self) -> tuple[str, ...]:
        """The ranges in which the dense depth's MAE is larger than that of geometry alone."""
        return tuple(name for name, entry in self.comparisons.items() if entry.is_worse)

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


def worse_than_geometry(overall: Mapping[str, Comparison], groupings: tuple[Grouping, ...]) -> dict[str, object]:
    """Plain values for JSON: for each range the share of worse frames, overall and by drive, and the worse drives."""
    drives = [group for entry in groupings if entry.name == BAG for group in entry.groups if group.comparisons]
    return {
        name: {
            "frames_share": json_number(comparison.frames_share),
            "drives": [drive.name for drive in drives if name in drive.worse_within],
            "frames_share_by_drive": {
                drive.name: json_number(drive.comparisons[name].frames_share) for drive in drives
            },
        }
        for name, comparison in overall.items()
    }


class GroupMeans(Sums):
    """Averages over the frames of each group."""

    SUMMED = ("_groups",)

    def __init__(self) -> None:
        self._groups: defaultdict[str, _Groups] = defaultdict(_Groups)

    def add(
        self,
        properties: Mapping[str, str],
        dense: npt.NDArray[np.float64],
        baselines: Mapping[str, npt.NDArray[np.float64]],
    ) -> None:
        """Adds a frame.

        Args:
            properties: What the frame is grouped by: the name of each property and its value.
            dense: The frame's measures, (ranges, 8) in the order of `RANGES` and `MEASURES`.
            baselines: The same of each baseline, by its name.
        """
        for name, value in properties.items():
            self._groups[name][value].add(dense, baselines)

    def result(self) -> tuple[Grouping, ...]:
        """The averages so far."""
        return tuple(Grouping(name, tuple(self._sorted(name))) for name in self._groups)

    def _sorted(self, name: str) -> Iterator[Group]:
        groups = self._groups[name]
        for value in [value for value in RETURN_BINS if value in groups] if name == RETURNS else groups:
            yield groups[value].result()


class _Groups(dict[str, "_GroupMeans"]):
    """The groups of one property by its value."""

    def __missing__(self, value: str) -> _GroupMeans:
        self[value] = _GroupMeans(value)
        return self[value]


class _GroupMeans(Sums):
    """Averages over the frames of one group."""

    SUMMED = ("_means", "_comparison")

    def __init__(self, value: str) -> None:
        self._value, self._comparison = value, ComparisonMeans()
        self._means: defaultdict[str, FrameMean] = defaultdict(lambda: FrameMean(value))

    def add(self, dense: npt.NDArray[np.float64], baselines: Mapping[str, npt.NDArray[np.float64]]) -> None:
        for kind, measures in (("", dense), *baselines.items()):
            self._means[kind].add(measures[-1])
        if GEOMETRY in baselines:
            self._comparison.add(dense, baselines[GEOMETRY])

    def result(self) -> Group:
        entries = {kind: mean.result() for kind, mean in self._means.items()}
        compared = self._comparison.result() if GEOMETRY in entries else {}
        return Group(self._value, entries.pop(""), entries, compared)
