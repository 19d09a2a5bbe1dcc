"""Problems, rates and durations of the node's parts, without ROS."""

from __future__ import annotations

import re
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

SECOND_NS = 1_000_000_000


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """One line of `/diagnostics`.

    Attributes:
        name: The part of the node, such as "camera".
        level: How it does.
        message: One sentence.
        values: Names and values for whoever looks closer.
    """

    name: str
    level: Level
    message: str
    values: tuple[tuple[str, str], ...] = ()


_GRAVITY = (Level.ERROR, Level.WARN, Level.STALE, Level.OK)


def summary(parts: Sequence[Status]) -> Status:
    """The whole in one line, `health`: as bad as its worst part, where an error is worse than what is not known yet."""
    worst = next((level for level in _GRAVITY if any(part.level is level for part in parts)), Level.STALE)
    concerned = [part for part in parts if part.level is worst]
    values = tuple((part.name, part.level.name) for part in parts)
    if worst is Level.OK:
        return Status("health", worst, worst.name, values)
    others = f" (and {', '.join(part.name for part in concerned[1:])})" if len(concerned) > 1 else ""
    sentence = f"{worst.name}: {concerned[0].name}: {concerned[0].message}{others}" if concerned else worst.name
    return Status("health", worst, sentence, values)


@dataclass
class _Problem:
    level: Level
    sentence: str
    told: bool = False
    over: bool = False


class Problems:
    """The present problem of each part; written to by callbacks and the worker, read by diagnostics.

    A problem stays until the part works again, and in any case until it was told once, so that a single bad message
    between two diagnostics is not lost. Each is logged as well, at most once in a while for sentences that differ in
    numbers only.

    Args:
        log: Called with a level and a line.
        interval_s: Seconds between two lines of a kind.
    """

    _KINDS_KEPT = 256

    def __init__(self, log: Callable[[Level, str], None], interval_s: float = 10.0) -> None:
        self._log = log
        self._interval_ns = round(interval_s * SECOND_NS)
        self._lock = threading.Lock()
        self._present: dict[str, _Problem] = {}
        self._counts: dict[str, int] = {}
        self._last: dict[str, str] = {}
        self._logged: OrderedDict[tuple[str, str], int] = OrderedDict()

    def report(self, part: str, level: Level, sentence: str, *, quietly: bool = False) -> None:
        """Something is wrong with a part.

        Args:
            part: Which.
            level: How bad it is.
            sentence: What was expected, what came, what to do.
            quietly: Don't log it.
        """
        with self._lock:
            self._present[part] = _Problem(level, sentence)
            self._counts[part] = self._counts.get(part, 0) + 1
            self._last[part] = sentence
            is_due = not quietly and self._is_due(part, sentence, time.monotonic_ns())
        if is_due:
            self._log(level, f"{part}: {sentence}")

    def settle(self, part: str) -> None:
        """A part works (again)."""
        with self._lock:
            problem = self._present.get(part)
            if problem is not None:
                problem.over = True
                if problem.told:
                    del self._present[part]

    def settle_all(self) -> None:
        """All parts begin anew: what was wrong before does not count."""
        with self._lock:
            self._present.clear()

    def show(self, *parts: str) -> tuple[Level, str] | None:
        """Level and sentence of the first of these parts that has a problem; problems that are over are forgotten."""
        with self._lock:
            told = [self._present[part] for part in parts if part in self._present]
            for part in parts:
                if part in self._present:
                    self._present[part].told = True
                    if self._present[part].over:
                        del self._present[part]
            return (told[0].level, told[0].sentence) if told else None

    def peek(self, part: str) -> str | None:
        """The sentence of a part's problem, unless it is over."""
        with self._lock:
            problem = self._present.get(part)
            return None if problem is None or problem.over else problem.sentence

    def is_logged(self, part: str) -> bool:
        """Whether the log has the sentence of a part's problem, or the same with other numbers."""
        with self._lock:
            problem = self._present.get(part)
            return problem is not None and _kind(part, problem.sentence) in self._logged

    def history(self, *parts: str) -> tuple[tuple[str, str], ...]:
        """How many problems parts had and the last one of each, as diagnostics values."""
        with self._lock:
            return tuple(
                value
                for part in parts
                if part in self._counts
                for value in (
                    (f"{part}: problems", str(self._counts[part])),
                    (f"{part}: last problem", self._last[part]),
                )
            )

    def _is_due(self, part: str, sentence: str, now_ns: int) -> bool:
        key = _kind(part, sentence)
        last_ns = self._logged.get(key)
        if last_ns is not None and now_ns - last_ns < self._interval_ns:
            return False
        self._logged[key] = now_ns
        self._logged.move_to_end(key)
        if len(self._logged) > self._KINDS_KEPT:
            self._logged.popitem(last=False)
        return True


def _kind(part: str, sentence: str) -> tuple[str, str]:
    """What sentences that differ in numbers only have in common."""
    return part, re.sub(r"\d+(\.\d+)?", "#", sentence)


class Rate:
    """How often something happens, over the last seconds.

    Args:
        window_s: How far back to look.
    """

    def __init__(self, window_s: float = 5.0) -> None:
        self._window_ns = round(window_s * SECOND_NS)
        self._times: deque[int] = deque(maxlen=512)
        self.count = 0
        """How often it happened at all."""

    def tick(self, now_ns: int) -> None:
        """It happens now."""
        self._times.append(now_ns)
        self.count += 1

    def hertz(self, now_ns: int) -> float:
        """Happenings a second, 0 when there were less than two of late."""
        recent = [time for time in tuple(self._times) if now_ns - time <= self._window_ns]
        if len(recent) < 2 or recent[-1] == recent[0]:
            return 0.0
        return (len(recent) - 1) * SECOND_NS / (recent[-1] - recent[0])

    def age_s(self, now_ns: int) -> float | None:
        """Seconds since it last happened; None when it never did."""
        return (now_ns - self._times[-1]) / SECOND_NS if self._times else None


class Durations:
    """Percentiles of the last durations of something."""

    def __init__(self, size: int = 512) -> None:
        self._values_ns: deque[int] = deque(maxlen=size)

    def add(self, duration_ns: int) -> None:
        """It took this long."""
        self._values_ns.append(duration_ns)

    def percentiles_ms(self, percentiles: Iterable[float] = (50.0, 95.0, 99.0)) -> tuple[float, ...]:
        """Milliseconds at each percentile; empty when there is nothing yet."""
        values = np.array(tuple(self._values_ns), np.float64)
        return tuple(float(value) for value in np.percentile(values, tuple(percentiles)) / 1e6) if len(values) else ()
