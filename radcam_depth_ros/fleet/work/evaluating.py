"""Evaluates one drive: its sums, its worst frames, and how much the network doubts it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from radcam_depth_ros import configuration
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.evaluation.drive import EvaluationSettings, Observation, sum_drive
from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
from radcam_depth_ros.evaluation.published import published_drives, sum_published
from radcam_depth_ros.evaluation.sources import DriveSource, name_of
from radcam_depth_ros.fleet.unit import Unit, Worker
from radcam_depth_ros.fleet.work.weights import Weights
from radcam_depth_ros.geometry import project


@dataclass(frozen=True)
class Evaluating:
    """The work of `radcam-depth evaluate`.

    Attributes:
        weights: The network.
        drive: How bags are read.
        measuring: What is measured.
        protocol: Name of a published protocol; None for the project's own measures.
        limit: Of each bag at most so many frames; None for all.
    """

    weights: Weights
    drive: DriveSettings
    measuring: EvaluationSettings
    protocol: str | None = None
    limit: int | None = None

    verb: ClassVar[str] = "evaluate"
    suffix: ClassVar[str] = ""
    reads_bags: ClassVar[bool] = True

    @property
    def threads(self) -> int:
        """Those of the network."""
        return self.weights.computation.threads

    def settings(self) -> dict[str, Any]:
        """All but where the bags are."""
        return {
            **self.weights.settings(),
            "measuring": configuration.as_mapping(self.measuring),
            "protocol": self.protocol,
            "limit": self.limit,
            "drive": configuration.as_mapping(self.drive),
        }

    def facts(self) -> dict[str, Any]:
        """The weights."""
        return self.weights.facts()

    def open(self) -> Worker:
        """Loads the network."""
        estimator = self.weights.load()

        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            about = {"name": name_of(bag), "folder": Path(unit.place).parent.name}
            measure = self._measured if self.protocol is None else self._published
            return {**about, **measure(bag, estimator)}

        return work

    def _measured(self, bag: Path, estimator: Estimator) -> dict[str, Any]:
        source, signs = DriveSource.find(bag, self.drive, self.limit), _Signs()
        drive = source.drive(source.name, self.drive, estimator.warm_up, lambda: None)
        sums = sum_drive(drive, estimator.estimate, self.measuring, signs.add)
        return {"sums": sums.plain(), "scenario": dict(source.scenario), **signs.plain()}

    def _published(self, bag: Path, estimator: Estimator) -> dict[str, Any]:
        protocol = PROTOCOLS[str(self.protocol)]
        (drive,), _ = published_drives([bag], self.drive, protocol, self.limit)
        return {"sums": sum_published(drive, estimator.estimate, protocol).plain(), "scenario": dict(drive.scenario)}


class _Signs:
    """What tells without ground truth that a drive is worth a look; of each frame, then averaged."""

    def __init__(self) -> None:
        self._doubts: list[float] = []
        self._differences: list[float] = []
        self._radars: dict[str, None] = {}

    def add(self, observation: Observation) -> None:
        """Adds a frame."""
        frame, result = observation.sample.frame, observation.result
        self._radars.update(dict.fromkeys(observation.sample.radars))
        self._doubts.append(float(1.0 - np.nan_to_num(result.confidence).mean()))
        uv, depth_m = project(frame.radar.xyz_m, frame.camera)
        with np.errstate(invalid="ignore"):
            inside = (depth_m > 0) & (uv >= 0).all(axis=1)
            inside &= (uv[:, 0] < frame.camera.width - 1) & (uv[:, 1] < frame.camera.height - 1)
        if inside.any():
            column, row = uv[inside].round().astype(int).T
            share = np.abs(result.dense[row, column] - depth_m[inside]) / depth_m[inside]
            self._differences.append(float(np.median(share)))

    def plain(self) -> dict[str, Any]:
        """`doubt`: 1 less the mean confidence. `radar_difference`: median of |depth - return| / return, at returns."""
        return {
            "radars": list(self._radars),
            "doubt": _mean(self._doubts),
            "radar_difference": _mean(self._differences),
        }


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
