"""Merges the results of drives: exactly what one process gives that evaluates all of them, timings apart."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from radcam_depth_ros import configuration
from radcam_depth_ros.evaluation.drive import EvaluationSettings, EvaluationSums
from radcam_depth_ros.evaluation.groups import GEOMETRY
from radcam_depth_ros.evaluation.measures.metrics import RANGES, DepthMetrics, FrameMean
from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
from radcam_depth_ros.evaluation.published import PublishedEvaluation, PublishedSums
from radcam_depth_ros.evaluation.sources import bags_json, distinct_names, listed
from radcam_depth_ros.evaluation.summary import Evaluation
from radcam_depth_ros.evaluation.tables import facts_of, without_truth
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.results import Results
from radcam_depth_ros.fleet.unit import Unit, units_of
from radcam_depth_ros.reporting.table import Fact


@dataclass(frozen=True)
class DriveLine:
    """One drive in the report over a fleet.

    Attributes:
        name: What its frames are filed under.
        folder: That its bag is in.
        frames: With ground truth within 80 m.
        mae_m: Of the dense depth within 80 m, metres; NaN without ground truth.
        geometry_mae_m: The same of geometry alone; NaN where it was not measured.
        doubt: 1 less the mean confidence.
        radar_difference: Median of |depth - return| / return at the radar's returns; NaN without returns.
        radars: Topics of its radars.
        scenario: Weather, time of day and so on.
    """

    name: str
    folder: str
    frames: int
    mae_m: float
    geometry_mae_m: float
    doubt: float
    radar_difference: float
    radars: tuple[str, ...]
    scenario: Mapping[str, str]


@dataclass(frozen=True)
class Merged:
    """Results of drives as one evaluation.

    Attributes:
        evaluation: The measures.
        bags: Places of the drives.
        names: What their frames are filed under.
        lines: One for each drive; none by a published protocol.
        facts: Of the plan.
        failed: Why drives failed, by their place; they are left out.
        missing: Places of drives that are not done yet, which are left out too.
    """

    evaluation: Evaluation | PublishedEvaluation
    bags: tuple[str, ...]
    names: tuple[str, ...]
    lines: tuple[DriveLine, ...]
    facts: Mapping[str, Any]
    failed: Mapping[str, str]
    missing: tuple[str, ...]

    def told(self) -> tuple[Fact, ...]:
        """What stands above the tables of the project's own measures."""
        if not isinstance(self.evaluation, Evaluation):
            return ()
        facts = [Fact("drives", listed(self.bags, self.names)), *without_truth(self.evaluation)]
        facts += facts_of(self.evaluation)
        if self.failed:
            facts.append(Fact("drives that failed and are left out", ", ".join(self.failed)))
        if self.missing:
            facts.append(Fact("drives that are not done yet and are left out", ", ".join(self.missing)))
        return (*facts, Fact("weights", f"{self.facts['weights']}, {self.facts['threads']} threads"))

    def as_json(self) -> dict[str, Any]:
        """As `radcam-depth evaluate --json` has it."""
        named = bags_json(self.bags) if isinstance(self.evaluation, Evaluation) else {"bags": list(self.bags)}
        return {**self.evaluation.as_json(), **named, **self.facts}


def merge(results: Results, units: Iterable[Unit] | None = None, *, partial: bool = False) -> Merged:
    """Joins the sums of drives in the order of the plan, one drive at a time.

    Args:
        results: What `radcam-depth evaluate --out` wrote.
        units: The drives to merge; None for all of the plan.
        partial: Leave drives out that are not done yet.

    Raises:
        FleetError: when there is nothing to merge, or a drive is neither done nor failed.
        EvaluationError: when no frame has ground truth, for a published protocol.
    """
    plan = results.plan
    if plan.verb != "evaluate":
        raise FleetError(
            f"{results.folder.place} holds results of `radcam-depth {plan.verb}`, which need no merging; give a folder "
            "of `radcam-depth evaluate --out`"
        )
    wanted = units_of(plan.drives) if units is None else tuple(units)
    failed = results.failures()
    # Looked for first: names follow from all drives together.
    names = {unit: str(body["name"]) for unit, body in _bodies(results, wanted)}
    missing = tuple(unit.place for unit in wanted if unit not in names and unit.place not in failed)
    if missing and not partial:
        raise FleetError(
            f"{len(missing)} of {len(wanted)} drives in {results.folder.place} are not done yet, {missing[0]} for one; "
            "run the same command again, or merge what is there by --partial"
        )
    if not names:
        raise FleetError(f"no drive of {results.folder.place} is done, so there is nothing to merge: see failed.jsonl")
    places = tuple(unit.place for unit in names)
    filed = distinct_names(list(names.values()), places)
    lines: list[DriveLine] = []
    protocol, network = plan.settings["protocol"], plan.settings["network"]
    evaluation: Evaluation | PublishedEvaluation
    if protocol is not None:
        published = PublishedSums()
        for _, body in _bodies(results, names):
            published.join(body["sums"])
        evaluation = published.result(PROTOCOLS[protocol], network)
    else:
        settings = configuration.build(EvaluationSettings, plan.settings["measuring"])
        sums = EvaluationSums(settings)
        for name, (_, body) in zip(filed, _bodies(results, names), strict=True):
            sums.join_drive(name, body["sums"])
            lines.append(_line(name, body))
        evaluation = sums.result()
    own = {place: why for place, why in failed.items() if place in {unit.place for unit in wanted}}
    return Merged(evaluation, places, tuple(filed), tuple(lines), plan.facts, own, missing)


def _bodies(results: Results, units: Iterable[Unit]) -> Iterator[tuple[Unit, Mapping[str, Any]]]:
    """The results that there are, read one at a time."""
    for unit in units:
        body = results.result(unit)
        if body is not None:
            yield unit, body


def _line(name: str, body: Mapping[str, Any]) -> DriveLine:
    sums = body["sums"]
    dense, baselines = _widest(sums["dense"]), {name: _widest(entry) for name, entry in sums["baselines"].items()}
    return DriveLine(
        name,
        str(body["folder"]),
        dense.frames,
        dense.mae,
        baselines[GEOMETRY].mae if GEOMETRY in baselines else math.nan,
        _number(body["doubt"]),
        _number(body["radar_difference"]),
        tuple(body["radars"]),
        body["scenario"],
    )


def _widest(depth: Mapping[str, Any]) -> DepthMetrics:
    """The measures within the widest range, from the sums of one kind of depth."""
    mean = FrameMean(RANGES[-1].name)
    mean.join(depth["ranges"]["means"][-1])
    return mean.result()


def _number(value: float | None) -> float:
    return math.nan if value is None else value
