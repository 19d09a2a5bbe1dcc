"""Worker processes: each handles many cases, within limits of memory and time, and is replaced when it dies."""

from __future__ import annotations

import multiprocessing
import resource
import shutil
import signal
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from benchmarks.adversary.cases import MOST_MIB, Attack, Outcome, Place, defect
from benchmarks.memory import memory_mib

MOST_CPU_S = 60
"""Processor seconds that no case may take."""
_PATIENCE_S = 3600.0
_START_PATIENCE_S = 900.0
_END_PATIENCE_S = 120.0
_GUARD_BYTES = 3 * 1024**3
"""So much address space may be added: a case that wants all memory of the machine fails alone."""

Maker = Callable[[int, Place], Attack]


@dataclass(frozen=True)
class Report:
    """A case that has ended.

    Attributes:
        number: Its number.
        outcome: What it gave.
        seconds: How long it took.
        peak_mib: Most resident memory meanwhile.
        is_good: Whether this is the good one after the case.
    """

    number: int
    outcome: Outcome
    seconds: float
    peak_mib: float
    is_good: bool = False


class WorkerError(Exception):
    """Workers that cannot start."""


class _Worker:
    def __init__(self, make: Maker, seed: int, folder: Path, kept: Path | None) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.folder = folder
        self._process = context.Process(target=_work, args=(make, seed, folder, kept, theirs))
        self._process.start()
        theirs.close()
        self.number: int | None = None
        self.since_s = time.monotonic()
        self.is_asked_to_end = False

    @property
    def is_late(self) -> bool:
        patience_s = _START_PATIENCE_S if self.number is None else _PATIENCE_S
        return time.monotonic() - self.since_s > patience_s

    def give(self, number: int | None) -> None:
        self.is_asked_to_end = number is None
        self.number = self.number if number is None else number
        self.since_s = time.monotonic()
        self.connection.send(number)

    def end(self, patience_s: float) -> str:
        """Ends the process, which may take so long to end by itself; returns how it ended."""
        self.connection.close()
        self._process.join(patience_s)
        was_alive = self._process.is_alive()
        if was_alive:
            self._process.kill()
            self._process.join()
        code = self._process.exitcode or 0
        if was_alive:
            return f"did not end within {_PATIENCE_S:.0f} s"
        if code == -signal.SIGXCPU:
            return f"took more than {MOST_CPU_S} s of processor time"
        return f"took the process down with {signal.Signals(-code).name if code < 0 else f'exit code {code}'}"


def run_cases(
    make: Maker,
    numbers: Iterable[int],
    seed: int,
    folder: Path,
    workers: int,
    told: Callable[[Report], None],
    kept: Path | None = None,
) -> None:
    """Runs cases in worker processes.

    Args:
        make: Makes the attack, in each worker.
        numbers: Of the cases.
        seed: What they are made of.
        folder: Where each worker has its own.
        workers: How many there are.
        told: Called with each case that has ended, and with each good one in between.
        kept: Files that each worker gets a copy of, as what its cases share.

    Raises:
        WorkerError: when a worker cannot start.
    """
    waiting = list(numbers)[::-1]
    started = 0

    def start() -> _Worker:
        nonlocal started
        started += 1
        return _Worker(make, seed, folder / str(started), kept)

    crew = [start() for _ in range(min(workers, len(waiting)))]
    try:
        while crew:
            ready = wait([worker.connection for worker in crew], timeout=1.0)
            for worker in list(crew):
                is_dead = worker.is_late
                if worker.connection in ready:
                    is_dead = not _take(worker, waiting, told)
                if not is_dead:
                    continue
                crew.remove(worker)
                # One that has closed its end of the connection is about to end.
                _bury(worker, told, 0.0 if worker.is_late else _END_PATIENCE_S)
                if waiting and not worker.is_asked_to_end:
                    crew.append(start())
    finally:
        for worker in crew:
            worker.end(0.0)


def _take(worker: _Worker, waiting: list[int], told: Callable[[Report], None]) -> bool:
    """Takes what a worker sent, and gives it the next case; False where it has ended."""
    try:
        report = worker.connection.recv()
    except (EOFError, ConnectionResetError):
        return False
    if isinstance(report, Report):
        told(report)
        if report.is_good:
            return True
    if not worker.is_asked_to_end:
        worker.give(waiting.pop() if waiting else None)
    return True


def _bury(worker: _Worker, told: Callable[[Report], None], patience_s: float) -> None:
    """Tells how a worker ended, unless it was asked to."""
    how, number = worker.end(patience_s), worker.number
    if worker.is_asked_to_end and how.endswith("exit code 0"):
        return
    printed = worker.folder / "told"
    lines = printed.read_text(encoding="utf-8", errors="replace").splitlines()[-3:] if printed.exists() else []
    if number is None:
        raise WorkerError(f"a worker {how} before its first case: {' '.join(lines)}")
    problems = (f"{how}: {' '.join(lines)[-300:]}",)
    told(Report(number, Outcome("see --only", "failed", problems), time.monotonic() - worker.since_s, 0.0))


def _work(make: Maker, seed: int, folder: Path, kept: Path | None, connection: Connection[Any, Any]) -> None:
    """Runs cases as they come, until None comes."""
    place = Place(folder)
    for file in kept.iterdir() if kept else ():
        shutil.copy(file, place.kept)
    place.enter()
    attack = make(seed, place)
    if attack.is_inside:
        _limit(resource.RLIMIT_AS, int(memory_mib("VmSize") * 2**20) + _GUARD_BYTES)
    connection.send("ready")
    count, number, good_after = 0, -1, -1
    while (given := _received(connection)) is not None:
        number, count = given, count + 1
        place.clear()
        # A good one comes first: the parent gives the next case for each other report.
        is_good_due = count % attack.good_every == 0
        report = _timed(attack, number, partial(attack.run, number))
        if is_good_due:
            good_after = number
            connection.send(_good(attack, place, number))
        connection.send(report)
    if number >= 0 and good_after != number:
        connection.send(_good(attack, place, number))
    attack.close()


def _received(connection: Connection[Any, Any]) -> int | None:
    """The next case; None where there is none, or where the parent is gone."""
    try:
        number: int | None = connection.recv()
    except EOFError:
        return None
    return number


def _good(attack: Attack, place: Place, number: int) -> Report:
    place.clear()

    def run() -> Outcome:
        problems = tuple(f"the good one after it: {problem}" for problem in attack.good())
        return Outcome("a good one", "wrong" if problems else "right", problems)

    return replace(_timed(attack, number, run), is_good=True)


def _timed(attack: Attack, number: int, run: Callable[[], Outcome]) -> Report:
    if attack.is_inside:
        used = resource.getrusage(resource.RUSAGE_SELF)
        _limit(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + MOST_CPU_S)
        _forget_peak()
    started = time.monotonic()
    try:
        outcome = run()
    except Exception as error:
        outcome = Outcome("see --only", "failed", (f"the attack itself failed: {defect(error)}",))
    seconds = time.monotonic() - started
    peak_mib = max(memory_mib("VmHWM") if attack.is_inside else 0.0, outcome.peak_mib)
    if peak_mib > MOST_MIB:
        problem = f"{peak_mib:.0f} MiB of memory, expected at most {MOST_MIB:.0f}"
        outcome = replace(outcome, problems=(*outcome.problems, problem))
    return Report(number, outcome, seconds, peak_mib)


def _limit(what: int, value: int) -> None:
    resource.setrlimit(what, (value, resource.getrlimit(what)[1]))


def _forget_peak() -> None:
    """Has the process's peak of memory begin anew."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
