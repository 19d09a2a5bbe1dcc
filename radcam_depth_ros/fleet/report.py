"""Tables over a fleet: the worst drives, which to look at next, and groups of drives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

from radcam_depth_ros.evaluation.groups import SCENARIO
from radcam_depth_ros.fleet.merging import DriveLine
from radcam_depth_ros.reporting.table import Table, number

ROWS = 20
"""Drives in a table of single drives."""
_NOTE = (
    "Doubt: 1 less the mean confidence, over all pixels. Radar apart: median of |depth - return| / return at the "
    "radar's returns. Both are of each frame, then averaged over the drive's frames, and need no ground truth."
)


def fleet_tables(lines: Sequence[DriveLine]) -> Iterator[Table]:
    """The tables; none for fewer than two drives."""
    if len(lines) < 2:
        return
    columns = ("", "MAE m, 80 m", "MAE m, geometry alone", "doubt %", "radar apart %", "frames", "scenario")
    for title, worth in (
        ("The worst drives", lambda line: line.mae_m),
        ("To label or record next: where the network doubts most", lambda line: line.doubt),
        ("To label or record next: where radar and depth differ most", lambda line: line.radar_difference),
    ):
        rows = tuple(_row(line) for line in _most(lines, worth))
        if rows:
            yield Table(title, columns, rows, _NOTE)
    properties: dict[str, Callable[[DriveLine], str]] = {"folder": lambda line: line.folder}
    properties |= {name: _of_scenario(name) for name in SCENARIO}
    properties["radars"] = lambda line: ", ".join(line.radars)
    for name, value in properties.items():
        groups: dict[str, list[DriveLine]] = {}
        for line in lines:
            groups.setdefault(value(line) or "unknown", []).append(line)
        if len(groups) > 1:
            rows = tuple(sorted((_group(name, members) for name, members in groups.items()), key=_worst_first))
            title = f"Drives by {name.replace('_', ' ')}, the worst first"
            yield Table(title, ("", "MAE m, 80 m", "doubt %", "radar apart %", "drives", "frames"), rows)


def _of_scenario(name: str) -> Callable[[DriveLine], str]:
    return lambda line: line.scenario.get(name, "")


def _most(lines: Iterable[DriveLine], worth: Callable[[DriveLine], float]) -> list[DriveLine]:
    known = [line for line in lines if not math.isnan(worth(line))]
    return sorted(known, key=worth, reverse=True)[:ROWS]


def _row(line: DriveLine) -> tuple[str, ...]:
    scenario = ", ".join(line.scenario[name] for name in SCENARIO if name in line.scenario)
    shares = (number(100 * share, 1) for share in (line.doubt, line.radar_difference))
    return (line.name, number(line.mae_m), number(line.geometry_mae_m), *shares, str(line.frames), scenario or "-")


def _group(name: str, lines: Sequence[DriveLine]) -> tuple[str, ...]:
    """A group's averages; the MAE over frames, as everywhere."""
    measured = [line for line in lines if line.frames]
    frames = sum(line.frames for line in measured)
    mae_m = sum(line.frames * line.mae_m for line in measured) / frames if frames else math.nan
    shares = (
        number(100 * _mean(values), 1)
        for values in ([line.doubt for line in lines], [line.radar_difference for line in lines])
    )
    return (name, number(mae_m), *shares, str(len(lines)), str(frames))


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan


def _worst_first(row: tuple[str, ...]) -> float:
    try:
        return -float(row[1])
    except ValueError:
        return math.inf
