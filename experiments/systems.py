"""Compares all networks: cost, and error on the same drives, with radar and without.

Run it from the repository's root, on drives that none of them was trained on; bags of one --drives are one set:

    python -m experiments.systems --drives simulated=out/test --drives real=../shared/data/astyx_val

Networks come with their shipped weights; --network NAME=FILE takes others, and --network NAME alone those of the
package. Operations are counted on an image of 900 x 1600 pixels, as the papers do. Times are of whole estimates of one
frame of the first set, all networks in turns, so that a busy moment of the machine hits all of them alike; a network
that works at half of another's focal length is given a quarter of its pixels.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from radcam_depth_ros.bags import find_bags
from radcam_depth_ros.benchmarking.rotation import Schedule, Task, in_rotation
from radcam_depth_ros.benchmarking.sections import count_gflop
from radcam_depth_ros.benchmarking.subject import NetworkInputs, Running, Size, Subject
from radcam_depth_ros.cli.terminal.options import write_json
from radcam_depth_ros.drive import Sample, read_samples
from radcam_depth_ros.estimator import Estimator
from radcam_depth_ros.evaluation.drive import Drive, EvaluationSettings, evaluate_drives
from radcam_depth_ros.evaluation.summary import DepthSummary, Evaluation
from radcam_depth_ros.frame import Frame
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io import archive

REFERENCE = "baff"
"""Whose time is 1."""

PAPERS_SIZE = Size.padded(900, 1600, 60)
RANGES_M = (50, 70, 80)
MEASURES = ("mae", "rmse", "absrel", "d1")
CAMERA_ONLY, GEOMETRY = "camera_only", "ground_nearest"


@dataclass(frozen=True)
class System:
    """A network with its weights.

    Attributes:
        name: In the registry.
        running: Loaded and ready.
    """

    name: str
    running: Running

    @classmethod
    def of(cls, text: str) -> System:
        """From NAME or NAME=FILE."""
        name, _, file = text.partition("=")
        return cls(name, Running.start(Subject(name, file, precision="float32")))

    @cached_property
    def estimator(self) -> Estimator:
        """Made ready to run once, for all that is measured of it."""
        return self.running.estimator()

    def cost(self) -> dict[str, float]:
        """Parameters in millions; operations in billions on the papers' image, 2 a multiply-add."""
        inputs = NetworkInputs.synthetic(PAPERS_SIZE, self.running.focal_length_px)
        parameters = sum(value.numel() for value in self.running.loaded.network.parameters())
        return {"parameters_m": parameters / 1e6, "gflop": count_gflop(self.running, inputs)}


def times(systems: Sequence[System], frame: Frame, rounds: int) -> dict[str, float]:
    """Median of the time of an estimate as a multiple of the reference's, by network; the first's where it lacks."""
    tasks = []
    for system in systems:
        system.estimator.warm_up(frame.camera)
        tasks.append(Task(system.name, partial(system.estimator.estimate, frame)))
    found = in_rotation(tasks, Schedule(rounds, 600.0), "cpu", lambda done, total: None)
    names = [system.name for system in systems]
    reference = found.of(REFERENCE if REFERENCE in names else names[0])
    return {name: float(np.median(found.of(name) / reference)) for name in names}


def figures(evaluation: Evaluation) -> dict[str, Any]:
    """Errors of a network with radar and without, and of geometry alone, by range."""
    kinds = {"dense": evaluation.dense, **evaluation.baselines}
    return {
        "frames": evaluation.frames,
        "coverage": evaluation.semi_dense.coverage,
        "semi_dense_mae": evaluation.semi_dense.metrics[-1].mae,
        **{name: _errors(summary) for name, summary in kinds.items()},
    }


def _errors(summary: DepthSummary) -> dict[str, dict[str, float]]:
    return {
        f"{range_m}": {name: float(getattr(summary.within(range_m), name)) for name in MEASURES} for range_m in RANGES_M
    }


def evaluate(system: System, bags: Sequence[Path], advance: Callable[[], None]) -> Evaluation:
    """Measures a network on a set of drives."""
    settings = EvaluationSettings(system.name, baselines=(GEOMETRY, CAMERA_ONLY))

    def counted(samples: Iterable[Sample]) -> Iterator[Sample]:
        for sample in samples:
            yield sample
            advance()

    return evaluate_drives((Drive(counted(read_samples(bag))) for bag in bags), system.estimator.estimate, settings)


def markdown(rows: Mapping[str, Mapping[str, Any]], sets: Sequence[str]) -> Iterator[str]:
    """Tables for a page: what networks cost, and their errors on each set of drives."""
    yield "| network | parameters | GFLOP | time |"
    yield "| --- | --- | --- | --- |"
    for name, row in rows.items():
        yield f"| `{name}` | {row['parameters_m']:.1f} M | {row['gflop']:.0f} | {row['time']:.2f} |"
    for entry in sets:
        yield ""
        yield f"{entry}:"
        yield ""
        heads = [f"{measure} {range_m} m" for measure in ("MAE", "RMSE", "AbsRel", "d1") for range_m in RANGES_M]
        yield f"| | {' | '.join(heads)} |"
        yield f"| {' | '.join(['---'] * (len(heads) + 1))} |"
        for name, row in rows.items():
            yield _errors_row(f"`{name}`", row[entry]["dense"])
            yield _errors_row(f"`{name}`, without radar", row[entry][CAMERA_ONLY])
        yield _errors_row(f"`{GEOMETRY}`", next(iter(rows.values()))[entry][GEOMETRY])


def _errors_row(name: str, errors: Mapping[str, Mapping[str, float]]) -> str:
    digits = {"mae": 2, "rmse": 2, "absrel": 3, "d1": 3}
    cells = (f"{errors[f'{range_m}'][measure]:.{digits[measure]}f}" for measure in MEASURES for range_m in RANGES_M)
    return f"| {name} | {' | '.join(cells)} |"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", action="append", required=True, metavar="NAME=PLACE", help="a set; repeatable")
    parser.add_argument(
        "--network", action="append", metavar="NAME[=FILE]", help="repeatable; all that have weights by default"
    )
    parser.add_argument("--rounds", type=int, default=15, help="turns of the timing")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file, - for stdout")
    options = parser.parse_args()
    options.network = options.network or [name for name in registry.names() if archive.shipped(name).is_file()]
    return options


def main() -> None:
    """Counts, times, measures, prints tables."""
    options = _options()
    sets = {name: find_bags([Path(place)]) for name, _, place in (text.partition("=") for text in options.drives)}
    systems = [System.of(text) for text in options.network]
    first = next(iter(read_samples(next(iter(sets.values()))[0]))).frame
    ratios = times(systems, first, options.rounds)
    rows: dict[str, dict[str, Any]] = {}
    with Progress(console=Console(stderr=True)) as progress:
        for system in systems:
            row: dict[str, Any] = {**system.cost(), "time": ratios[system.name]}
            for name, bags in sets.items():
                task = progress.add_task(f"{system.name}, {name}", total=None)
                row[name] = figures(evaluate(system, bags, partial(progress.advance, task)))
            row["weights"] = system.running.loaded.archive.card.training_data
            rows[system.name] = row
    if options.json:
        write_json({"image": str(PAPERS_SIZE), "networks": rows}, options.json)
    if options.json != "-":
        for line in markdown(rows, list(sets)):
            print(line)


if __name__ == "__main__":
    main()
