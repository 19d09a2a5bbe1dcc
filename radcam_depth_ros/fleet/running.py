"""Runs the work over the drives of a shard: skips those that are done; one that fails does not stop the others."""

from __future__ import annotations

import json
import resource
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from radcam_depth_ros.fleet.results import Done, Failed, Plan, Results
from radcam_depth_ros.fleet.shard import Shard
from radcam_depth_ros.fleet.unit import Unit, Work, Worker
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.storage import content_at, folder_at, staged, stamp_at

Engine = Callable[[Work, str, Iterable[Unit]], Iterator[tuple[Unit, Done | Failed]]]
"""Does units, given the work, the folder of outputs and the units, and gives each as it is done."""


@dataclass(frozen=True)
class RunSummary:
    """What a run did.

    Attributes:
        results: Where the results are.
        units: The drives of the shard.
        kept: How many of them were done before.
        failed: How many of them failed.
    """

    results: Results
    units: tuple[Unit, ...]
    kept: int
    failed: int


def run(
    work: Work,
    units: Sequence[Unit],
    out: str,
    shard: Shard | None = None,
    engine: Engine | None = None,
    progress: Callable[[], None] = lambda: None,
) -> RunSummary:
    """Does all drives of a shard that are not done yet.

    Args:
        work: What is done with each.
        units: All drives of the run, those of other shards as well.
        out: Folder of the results.
        shard: Which drives are done here; None for all.
        engine: Where they are done; None for this process.
        progress: Called when another drive of the shard is done.

    Raises:
        FleetError: when the folder has results of something else.
        FileError: when the folder cannot be written.
    """
    results = Results(out, Plan.of(work, units), work.suffix)
    results.begin()
    own = (shard or Shard()).take(units)
    todo, kept, failed = [], 0, 0
    for unit in own:
        if results.has(unit, stamp_of(work, unit), partial(_content, work, unit)):
            kept += 1
            progress()
        else:
            todo.append(unit)
    for unit, outcome in (engine or run_here)(work, out, todo) if todo else ():
        results.add(unit, outcome)
        failed += isinstance(outcome, Failed)
        progress()
    return RunSummary(results, own, kept, failed)


def run_here(work: Work, out: str, units: Iterable[Unit]) -> Iterator[tuple[Unit, Done | Failed]]:
    """The engine of this process: one drive after the other."""
    worker = work.open()
    for unit in units:
        yield unit, attempt(work, worker, out, unit)


def attempt(work: Work, worker: Worker, out: str, unit: Unit) -> Done | Failed:
    """Does one drive; whatever is wrong with it becomes a sentence."""
    start, local = time.perf_counter(), unit.place
    try:
        with staged(unit.place) as bag, folder_at(out).written(f"{unit.name}{work.suffix}") as target:
            local = str(bag)
            stamp, content = stamp_of(work, unit), _content(work, unit)
            body = worker(unit, bag, target)
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return Done(stamp, content, time.perf_counter() - start, memory_mb, json.dumps(body))
    except RadcamDepthError as error:
        return Failed(str(error).replace(local, unit.place))
    except (MemoryError, OSError) as error:
        return Failed(f"{unit.place}: {str(error) or type(error).__name__}")
    except Exception as error:  # a night's work must not end with one drive
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        return Failed(f"{unit.place}: {type(error).__name__} in {where}: {error}; please report this")


def stamp_of(work: Work, unit: Unit) -> str:
    """Size and time of change of a unit's bag, without reading it; empty where there is none."""
    return stamp_at(unit.place) if work.reads_bags else unit.place


def _content(work: Work, unit: Unit) -> str:
    return content_at(unit.place) if work.reads_bags else f"seed {unit.place}"
