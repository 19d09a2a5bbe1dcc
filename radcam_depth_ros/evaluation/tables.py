"""An evaluation as facts and tables of text, for a terminal and for the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from radcam_depth_ros.evaluation.metrics import DepthMetrics, EvaluationError
from radcam_depth_ros.evaluation.summary import Evaluation

DENSE, SEMI_DENSE, GEOMETRY = "dense", "semi-dense", "geometry alone"
_TITLES = {
    "mae": "MAE m",
    "rmse": "RMSE m",
    "absrel": "AbsRel",
    "log10": "log10",
    "rmselog": "RMSElog",
    "d1": "d1",
    "d2": "d2",
    "d3": "d3",
}
_HEIGHT_SOURCES = {
    "frame": "from the drive's transforms or the configuration",
    "given": "as given",
    "assumed": "assumed: the drive does not say",
}


@dataclass(frozen=True)
class Fact:
    """One line of what a result was made with."""

    name: str
    value: str


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: Above it.
        columns: Headings; the first column names the row.
        rows: Cells, as many a row as there are columns.
        note: Below it; what its terms mean.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise EvaluationError(
                    f"table {self.title!r} has {len(self.columns)} columns, but {len(row)} cells: {row}"
                )


def number(value: float, digits: int = 2) -> str:
    """A number for a cell; a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def summary_table(evaluation: Evaluation) -> Table:
    """Mean absolute and root mean squared errors within each range: what papers of this field compare."""
    kinds = _kinds(evaluation)
    ranges = [entry.name for entry in evaluation.dense.ranges]
    columns = ("", *(f"{title} {name}" for title in ("MAE", "RMSE") for name in ranges))
    rows = tuple(
        (name, *(number(entry.mae) for entry in entries), *(number(entry.rmse) for entry in entries))
        for name, entries in kinds
    )
    note = (
        "Averaged over the pixels with ground truth in range, then over frames. Semi-dense: where it has values. "
        "Geometry alone: the flat road, or the radar return nearest in the image where that is closer."
    )
    return Table("Error in metres, of all within 50, 70 and 80 m", columns, rows, note)


def detail_table(evaluation: Evaluation) -> Table:
    """All measures within each range."""
    rows = tuple(
        (f"{name}, {entry.name} m", *_measures(entry)) for name, entries in _kinds(evaluation) for entry in entries
    )
    note = "d1 to d3: share of pixels whose ratio to the truth is below 1.25, 1.25² and 1.25³."
    return Table("All measures", ("", *_TITLES.values(), "frames"), rows, note)


def distance_table(evaluation: Evaluation) -> Table:
    """Mean absolute error by distance."""
    names = [entry.name for entry in evaluation.dense.bins]
    rows = tuple(
        (name, *(number(entry.mae) for entry in entries))
        for name, entries in ((DENSE, evaluation.dense.bins), (GEOMETRY, evaluation.ground_nearest.bins))
    )
    return Table("MAE by distance of the ground truth, metres", ("", *(f"{name} m" for name in names)), rows)


def class_table(evaluation: Evaluation) -> Table:
    """The dense depth by what a pixel shows."""
    rows = tuple((entry.name, *_measures(entry)) for entry in evaluation.by_class)
    return Table(f"By class, within {evaluation.dense.ranges[-1].name} m", ("", *_TITLES.values(), "frames"), rows)


def tables_of(evaluation: Evaluation) -> tuple[Table, ...]:
    """Every table that has something to say about the evaluation."""
    tables = (summary_table(evaluation), distance_table(evaluation), detail_table(evaluation))
    return (*tables, class_table(evaluation)) if evaluation.by_class else tables


def facts_of(evaluation: Evaluation) -> tuple[Fact, ...]:
    """What the evaluation was made with."""
    facts = [Fact("network", evaluation.network), Fact("frames", str(evaluation.frames))]
    if evaluation.frames_missing:
        facts.append(Fact("frames without depth", str(evaluation.frames_missing)))
    facts.append(Fact("ground truth", evaluation.ground_truth))
    facts.append(Fact("semi-dense coverage", f"{number(100 * evaluation.semi_dense.coverage, 1)} %"))
    if math.isfinite(evaluation.camera_height_m):
        source = _HEIGHT_SOURCES[evaluation.camera_height_source]
        facts.append(Fact("camera above the road", f"{number(evaluation.camera_height_m)} m ({source})"))
    if evaluation.clip_m is not None:
        facts.append(Fact("predictions clipped to", f"{evaluation.clip_m:g} m in every range"))
    latency = evaluation.latency
    facts.append(
        Fact("time for an estimate", f"p50 {number(latency.p50_ms, 0)} ms, p99 {number(latency.p99_ms, 0)} ms")
    )
    return tuple(facts)


def _kinds(evaluation: Evaluation) -> tuple[tuple[str, Sequence[DepthMetrics]], ...]:
    return (
        (DENSE, evaluation.dense.ranges),
        (SEMI_DENSE, evaluation.semi_dense.metrics),
        (GEOMETRY, evaluation.ground_nearest.ranges),
    )


def _measures(entry: DepthMetrics) -> tuple[str, ...]:
    return (*(number(getattr(entry, name), 2 if name in ("mae", "rmse") else 3) for name in _TITLES), str(entry.frames))
