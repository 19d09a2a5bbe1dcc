"""Measures the load of the computer: usable cores, how busy they are, how long this process's threads wait."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

PROC, CGROUP = Path("/proc"), Path("/sys/fs/cgroup")
_NICE, _IDLE_FIELDS = 1, (3, 4)
"""Of a line of /proc/stat: work of low priority; idle and waiting for a disk."""


@dataclass(frozen=True)
class Load:
    """Times since the computer or the process started; only differences between two of them tell something.

    Attributes:
        at_s: When this was read, seconds of a steady clock.
        busy_s: Seconds that the cores which this process may run on were busy, all together, but for work that gives
            way to it; NaN where it is not told.
        own_s: Seconds that this process computed, all of its threads together.
        waited_s: Seconds that its threads were ready to run and waited for a core; NaN where it is not told.
    """

    at_s: float
    busy_s: float
    own_s: float
    waited_s: float

    @classmethod
    def now(cls) -> Load:
        """What the computer says now; Linux alone tells all of it."""
        return cls(time.monotonic(), _busy_s(), time.process_time(), _waited_s())


def usable_cores() -> int:
    """Cores that this process may use: by its affinity (taskset, cpuset) and its control group's quota."""
    allowed = len(allowed_cores())
    quota = min(_quotas(), default=math.inf)
    return max(1, min(allowed, int(quota + 0.5) if math.isfinite(quota) else allowed))


def allowed_cores() -> set[int]:
    """Numbers of the cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def _quotas() -> Iterator[float]:
    """Cores by the quotas of the process's control groups and those above them, versions 2 and 1."""
    for line in _text(PROC / "self" / "cgroup").splitlines():
        _, controllers, group = line.split(":", 2)
        names: tuple[str, ...]
        if not controllers:
            root, names = CGROUP, ("cpu.max",)
        elif "cpu" in controllers.split(","):
            root, names = CGROUP / "cpu", ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        else:
            continue
        own = PurePosixPath(group.lstrip("/"))
        # A container may see its own group as the root, whatever the path says: files that are not there say nothing.
        for folder in (own, *own.parents):
            words = [word for name in names for word in _text(root / folder / name).split()]
            # Without a quota there is `max` or -1 in them.
            if len(words) == 2 and all(word.isdecimal() and int(word) for word in words):
                yield int(words[0]) / int(words[1])


def _busy_s() -> float:
    # Work of low priority gives way to a process of the usual one.
    gives_way = os.getpriority(os.PRIO_PROCESS, 0) <= 0
    left_out = (*_IDLE_FIELDS, *((_NICE,) if gives_way else ()))
    allowed, ticks = allowed_cores(), []
    for line in _text(PROC / "stat").splitlines():
        name, *values = line.split()
        if name.startswith("cpu") and name[3:].isdecimal() and int(name[3:]) in allowed:
            # Guests' time is within the user's; what the host took (steal) was not to be had.
            ticks += [int(value) for index, value in enumerate(values[:8]) if index not in left_out]
    # None of the cores where a container numbers them anew.
    return sum(ticks) / os.sysconf("SC_CLK_TCK") if ticks else math.nan


def _waited_s() -> float:
    """The second number of each thread's schedstat, nanoseconds."""
    told = [_text(file).split() for file in (PROC / "self" / "task").glob("*/schedstat")]
    waited_ns = [int(numbers[1]) for numbers in told if len(numbers) > 1]
    return 1e-9 * sum(waited_ns) if waited_ns else math.nan


def _text(file: Path) -> str:
    """What a file of the system says; nothing where it is not there, such as of a thread that has just ended."""
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
