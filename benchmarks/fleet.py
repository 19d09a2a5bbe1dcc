"""Measures runs over many drives: `python -m benchmarks.fleet`.

- The overhead of a drive: what a run costs beside the work itself.
- The memory of the process that runs, over 10,000 results that are made up.
- With the extra `fleet`: the rate of 64 small drives on one and on two workers of Ray, between first and last result,
  one thread a worker. It needs as many free cores.
"""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from benchmarks.memory import memory_mib
from radcam_depth_ros import simulation
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.evaluation.drive import EvaluationSettings, EvaluationSums
from radcam_depth_ros.fleet.results import Done, Failed
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.unit import Unit, Work, Worker, units_of
from radcam_depth_ros.fleet.work.evaluating import Evaluating
from radcam_depth_ros.fleet.work.weights import Weights


@dataclass(frozen=True)
class Nothing:
    """Work that gives sums of nothing, of the usual form and size."""

    verb: ClassVar[str] = "nothing"
    suffix: ClassVar[str] = ""
    reads_bags: ClassVar[bool] = True

    @property
    def threads(self) -> int:
        """One."""
        return 1

    def settings(self) -> dict[str, Any]:
        """None."""
        return {}

    def facts(self) -> dict[str, Any]:
        """None."""
        return {}

    def open(self) -> Worker:
        """Makes the sums once."""
        sums = EvaluationSums(EvaluationSettings()).plain()

        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            return {"sums": sums}

        return work


def overhead_ms(folder: Path, drives: int) -> float:
    """Milliseconds of a run for each drive of a megabyte, beside the work itself."""
    places = []
    for index in range(drives):
        place = folder / "drives" / f"{index}.mcap"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(bytes(1 << 20))
        places.append(str(place))
    start = time.perf_counter()
    run(Nothing(), units_of(places), str(folder / "out"))
    return 1000 * (time.perf_counter() - start) / drives


def memory_of(folder: Path, drives: int) -> list[tuple[int, float]]:
    """Resident memory (MiB) after some numbers of results, which come from nowhere."""
    body = json.dumps({"sums": EvaluationSums(EvaluationSettings()).plain()})
    seen: list[tuple[int, float]] = []

    def engine(work: Work, out: str, units: Iterable[Unit]) -> Iterator[tuple[Unit, Done | Failed]]:
        for index, unit in enumerate(units):
            yield unit, Done("1 1", f"{index}", 1.0, 1.0, body)
            if index + 1 in (drives // 10, drives):
                seen.append((index + 1, memory_mib("VmRSS")))

    units = units_of([f"/nowhere/{index}.mcap" for index in range(drives)])
    run(Nothing(), units, str(folder / "out"), None, engine)
    return seen


def ray_rate(folder: Path, bag: Path, drives: int, workers: int) -> float:
    """Drives a second on so many workers of Ray, from the first result of each worker to the last of all."""
    import ray

    from radcam_depth_ros.fleet.on_ray import ray_engine

    places = []
    for index in range(drives):
        place = folder / "drives" / f"{index}.mcap"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(bag, place)
        places.append(str(place))
    estimator = Estimator(EstimatorConfig(precision="float32", threads=1, output_size="native"))
    work = Evaluating(Weights.of(estimator), DriveSettings(), EvaluationSettings(estimator.card.network))
    ray.init(num_cpus=workers, log_to_driver=False, logging_level=logging.ERROR, include_dashboard=False)
    times: list[float] = []
    summary = run(
        work, units_of(places), str(folder / "out"), None, ray_engine("ray"), lambda: times.append(time.perf_counter())
    )
    if summary.failed:
        raise RuntimeError(f"{summary.failed} drives failed: {summary.results.failures()}")
    return (len(times) - workers) / (times[-1] - times[workers - 1])


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=int, default=10_000, help="results that are made up")
    parser.add_argument("--drives", type=int, default=64, help="small drives on Ray; 0 for none")
    parser.add_argument("--frames", type=int, default=4, help="frames of a small drive")
    arguments = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        print(f"overhead: {overhead_ms(folder / 'overhead', 100):.1f} ms a drive")
        for count, mib in memory_of(folder / "memory", arguments.results):
            print(f"memory after {count} results: {mib:.0f} MiB")
        if arguments.drives:
            bag = folder / "drive.mcap"
            camera = simulation.CameraConfig(width=448, height=256)
            simulation.simulate(simulation.SimulationConfig(camera=camera), 1_000_001, arguments.frames, bag)
            one, two = (ray_rate(folder / f"workers_{workers}", bag, arguments.drives, workers) for workers in (1, 2))
            print(
                f"drives a second on Ray: {one:.2f} with one worker, {two:.2f} with two, {two / one:.2f} times as many"
            )


if __name__ == "__main__":
    main()
