"""Measures recorded depth against a drive's ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from demo.plan import Plan
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.evaluation.drive import EvaluationSettings, evaluate_drive
from radcam_depth_ros.evaluation.panels import PanelKeeper
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import tables_of
from radcam_depth_ros.reporting.page import write_report
from radcam_depth_ros.reporting.table import Fact, Table
from radcam_depth_ros.viewing import RecordedDepth

DEPTH, CAMERA_INFO, SEMI_DENSE, CONFIDENCE = (
    f"/{OUTPUTS[name].topic}" for name in ("depth", "depth_camera_info", "semi_dense", "confidence")
)


@dataclass(frozen=True)
class Traffic:
    """What went in and came out, live.

    Attributes:
        sent_s: Stamp of each image that was played, nanoseconds, to its steady time, seconds.
        arrived_s: The same of each depth image that came.
    """

    sent_s: dict[int, float]
    arrived_s: dict[int, float]

    @property
    def dropped(self) -> int:
        """Images without a depth image."""
        return len(self.sent_s.keys() - self.arrived_s.keys())

    def table(self) -> Table:
        """Counts, and the time from an image's publishing to its depth image's arrival."""
        both = self.sent_s.keys() & self.arrived_s.keys()
        latencies_ms = [1000 * (self.arrived_s[stamp] - self.sent_s[stamp]) for stamp in both]
        p50, p99 = np.percentile(latencies_ms, (50, 99)) if latencies_ms else (np.nan, np.nan)
        counts = (len(self.sent_s), len(self.arrived_s), self.dropped)
        return Table(
            "Through the node",
            ("", "frames in", "out", "dropped", "latency p50 ms", "p99 ms"),
            (("live", *(str(count) for count in counts), f"{p50:.0f}", f"{p99:.0f}"),),
            "Latency: from the image's publishing to the arrival of its depth image, both over DDS.",
        )


def measure(plan: Plan, recording: Path) -> tuple[Evaluation, PanelKeeper]:
    """Measures a recording of the node's depth over the drive that was played."""
    keeper = PanelKeeper()
    with BagReader(recording) as reader:
        evaluation = evaluate_drive(
            read_samples(plan.bag, DriveSettings()),
            RecordedDepth(reader).predict,
            EvaluationSettings("the node"),
            keeper.add,
        )
    return evaluation, keeper


def write_page(path: Path, plan: Plan, traffic: Traffic, evaluation: Evaluation, keeper: PanelKeeper) -> None:
    """Writes the report."""
    facts = tuple(_facts(plan, evaluation))
    tables = (traffic.table(), *(tables_of(evaluation) if evaluation.has_ground_truth else ()))
    title = f"{plan.bag.resolve().stem} through the live node"
    write_report(path, title, facts, tables, keeper.panels(), highlights=keeper.highlights())


def _facts(plan: Plan, evaluation: Evaluation) -> Iterator[Fact]:
    yield Fact("drive", str(plan.bag))
    yield Fact("camera", plan.sensors.image)
    yield Fact("radar", ", ".join(plan.sensors.radars))
    yield Fact("ground truth", evaluation.ground_truth)
    yield Fact("semi-dense coverage", f"{100 * evaluation.semi_dense.coverage:.1f} %")
