"""Metrics of each frame: a CSV file, and a table of the worst frames."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from radcam_depth_ros.evaluation.drive import FrameMeasures, Observation
from radcam_depth_ros.evaluation.groups import SCENARIO
from radcam_depth_ros.evaluation.measures.metrics import MEASURES, RANGES
from radcam_depth_ros.evaluation.tables import BASELINE_TITLES
from radcam_depth_ros.files import write_text
from radcam_depth_ros.reporting.table import Table, number


@dataclass(frozen=True)
class FrameRecord:
    """One frame without its images.

    Attributes:
        bag: Name of its bag.
        index: Number of the frame within its bag.
        stamp_ns: Its stamp.
        ground_truth: As in `Sample.source`.
        scenario: The values of `SCENARIO`, empty where unknown.
        measures: Its measures.
    """

    bag: str
    index: int
    stamp_ns: int
    ground_truth: str
    scenario: tuple[str, ...]
    measures: FrameMeasures

    @property
    def mae_m(self) -> float:
        """Mean absolute error of the dense depth within the widest range."""
        return float(self.measures.dense[-1, 0])


class FrameLog:
    """Keeps the measures of all frames; pass `add` to `evaluate_drives` as its observer."""

    def __init__(self) -> None:
        self._records: list[FrameRecord] = []

    def add(self, observation: Observation) -> None:
        """Adds a frame."""
        drive, sample = observation.drive, observation.sample
        scenario = tuple(drive.scenario.get(name, "") for name in SCENARIO)
        self._records.append(
            FrameRecord(
                drive.name,
                observation.index,
                sample.frame.stamp_ns,
                sample.source,
                scenario,
                observation.measures,
            )
        )

    def write_csv(self, path: Path | str) -> None:
        """Writes a line a frame, whole or not at all; empty where there is no number.

        Columns: bag, frame, stamp_ns, ground_truth, the scenario, returns_in_view, latency_ms, every measure of the
        dense depth within each range (`mae_50`), `semi_dense_coverage`, `semi_dense_mae_80`, and `mae_80` and `rmse_80`
        of each baseline behind its name.

        Raises:
            FileError: when the file cannot be written.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        widest = RANGES[-1].name
        names = list(self._records[0].measures.baselines) if self._records else []
        writer.writerow(
            [
                *("bag", "frame", "stamp_ns", "ground_truth", *SCENARIO, "returns_in_view", "latency_ms"),
                *(f"{measure}_{entry.name}" for entry in RANGES for measure in MEASURES),
                *("semi_dense_coverage", f"semi_dense_mae_{widest}"),
                *(f"{name}_{measure}_{widest}" for name in names for measure in ("mae", "rmse")),
            ]
        )
        for record in self._records:
            measures = record.measures
            values = [
                *measures.dense.ravel().tolist(),
                *(measures.coverage, measures.semi_dense_mae_m),
                *(measures.baselines[name][-1, column] for name in names for column in (0, 1)),
            ]
            writer.writerow(
                [
                    *(record.bag, record.index, record.stamp_ns, record.ground_truth, *record.scenario),
                    *(measures.returns_in_view, f"{1000 * measures.latency_s:.1f}"),
                    *(f"{value:.6g}" if math.isfinite(value) else "" for value in values),
                ]
            )
        write_text(path, text.getvalue())

    def worst_table(self, count: int = 10) -> Table:
        """The frames with the largest errors, the worst first."""
        known = [record for record in self._records if math.isfinite(record.mae_m)]
        worst = sorted(known, key=lambda record: record.mae_m, reverse=True)[:count]
        names = list(worst[0].measures.baselines) if worst else []
        shown = [index for index, _ in enumerate(SCENARIO) if any(record.scenario[index] for record in worst)]
        columns = (
            *("bag and frame", "stamp s", *(SCENARIO[index].replace("_", " ") for index in shown), "returns"),
            *("MAE m", "RMSE m", *(f"MAE m, {BASELINE_TITLES[name]}" for name in names)),
        )
        rows = tuple(
            (
                f"{record.bag} {record.index}".strip(),
                f"{record.stamp_ns / 1e9:.3f}",
                *(record.scenario[index] or "-" for index in shown),
                str(record.measures.returns_in_view),
                *(number(value) for value in record.measures.dense[-1, :2]),
                *(number(record.measures.baselines[name][-1, 0]) for name in names),
            )
            for record in worst
        )
        return Table(f"The worst frames, within {RANGES[-1].name} m", columns, rows)
