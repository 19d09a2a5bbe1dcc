"""Times several tasks in turns, so that a busy moment of the machine hits all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from radcam_depth_ros.benchmarking.subject import BenchmarkError

LEAST_ROUNDS = 2

Watch = Callable[[str, int, int], None]
"""Is told what is going on, how many rounds of it are done, and how many there will be."""


@dataclass(frozen=True)
class Schedule:
    """How long to measure.

    Attributes:
        repeats: Rounds for each size, at most; pairs of a comparison likewise.
        budget_s: Seconds after which no further round is begun: what is slow gets fewer rounds, two at least.
    """

    repeats: int = 30
    budget_s: float = 90.0

    def __post_init__(self) -> None:
        if self.repeats < 1 or not self.budget_s > 0:
            raise BenchmarkError(
                f"repeats and budget_s must be positive, got {self.repeats} rounds and {self.budget_s} s"
            )


@dataclass(frozen=True)
class Task:
    """Something to time.

    Attributes:
        name: What it is.
        call: Does it once.
        turn_s: It is done again until so many seconds have passed, and the median counts: what is fast is then not
            always met in the state that something slow has left the caches in.
    """

    name: str
    call: Callable[[], object]
    turn_s: float = 0.0


@dataclass(frozen=True)
class Times:
    """Times of several tasks.

    Attributes:
        names: Of the tasks.
        ms: (rounds, tasks) float64, milliseconds.
    """

    names: tuple[str, ...]
    ms: npt.NDArray[np.float64]

    def of(self, name: str) -> npt.NDArray[np.float64]:
        """(rounds,) milliseconds, the sum over all tasks of that name."""
        total: npt.NDArray[np.float64] = self.ms[:, [entry == name for entry in self.names]].sum(axis=1)
        return total


def in_rotation(tasks: Sequence[Task], schedule: Schedule, device: str, watch: Callable[[int, int], None]) -> Times:
    """Does all tasks in turn, round by round.

    Args:
        tasks: What to time; warmed up by the caller.
        schedule: How long.
        device: Where the tasks run: on a GPU they are waited for.
        watch: Is told how many rounds are done and how many there will be.
    """
    rounds: list[list[float]] = []
    began_s = time.perf_counter()
    expected = schedule.repeats
    while len(rounds) < expected:
        watch(len(rounds), expected)
        rounds.append([_turn(task, device) for task in tasks])
        round_s = (time.perf_counter() - began_s) / len(rounds)
        expected = min(schedule.repeats, max(LEAST_ROUNDS, int(schedule.budget_s / round_s)))
    watch(len(rounds), len(rounds))
    return Times(tuple(task.name for task in tasks), np.array(rounds).reshape(len(rounds), len(tasks)))


def _turn(task: Task, device: str) -> float:
    """Milliseconds of a task."""
    seconds: list[float] = []
    while not seconds or sum(seconds) < task.turn_s:
        began_s = time.perf_counter()
        task.call()
        if device != "cpu":
            torch.cuda.synchronize(device)
        seconds.append(time.perf_counter() - began_s)
    return 1e3 * statistics.median(seconds)
