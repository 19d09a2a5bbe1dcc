"""Figures of a soak of the live node: memory, latency and pairs over time, and whether each holds its target."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SETTLE_S = 300.0
"""Memory counts from here on; latency is compared between the first span of this length and the last."""
SHARE_OF_SHORT = 6
"""Of a soak that is shorter than so many of these spans, they are one such part."""
MEMORY_GROWTH_PERCENT = 1.0
LATENCY_CHANGE_PERCENT = 10.0
CAUSES = ("overload", "failed", "without radar")
"""Why a pair gives no depth, as `/diagnostics` calls it."""
_WINDOWS_OF_SPAN = 5
_POINTS_WRITTEN = 200


@dataclass(frozen=True)
class Reading:
    """What Linux tells of the node's process, and of the machine.

    Attributes:
        at_s: Since the soak began.
        rss_mib: Resident memory.
        threads: How many it has.
        files: File descriptors that are open.
        stolen_s: Processor seconds that the host of a virtual machine gave to others, since that machine started.
    """

    at_s: float
    rss_mib: float
    threads: int
    files: int
    stolen_s: float


def read_process(pid: int, at_s: float) -> Reading:
    """What a process has now."""
    process = Path(f"/proc/{pid}")
    lines = dict(
        line.split(":", 1) for line in (process / "status").read_text(encoding="utf-8").splitlines() if ":" in line
    )
    files = sum(1 for _ in (process / "fd").iterdir())
    # The first line: "cpu", and the ticks in user, nice, system, idle, iowait, irq, softirq, steal.
    ticks = Path("/proc/stat").read_text(encoding="utf-8").split(maxsplit=9)
    stolen_s = int(ticks[8]) / os.sysconf("SC_CLK_TCK")
    return Reading(at_s, float(lines["VmRSS"].split()[0]) / 1024, int(lines["Threads"]), files, stolen_s)


@dataclass(frozen=True)
class Counts:
    """What the node counted since it is active, from `/diagnostics`.

    Attributes:
        heard: Images that came.
        refused: Of these, those that could not be used, or were there already.
        waiting: Images that wait for their radar sweeps.
        with_radar: Images that were paired with a sweep.
        pairs: What was handed to the network: images with their sweeps, or without where none was near.
        out: Depth images.
        drops: Pairs that gave no depth, for each of `CAUSES`.
        jumps: How often stamps jumped back.
    """

    heard: int
    refused: int
    waiting: int
    with_radar: int
    pairs: int
    out: int
    drops: tuple[int, ...]
    jumps: int

    @classmethod
    def read(cls, statuses: dict[str, dict[str, str]]) -> Counts | None:
        """From the values of each status by its name; None of a node that is not active yet."""
        output, pairing, inference = (statuses.get(name, {}) for name in ("output", "pairing", "inference"))
        if "images" not in output or "images" not in pairing:
            return None
        refusals = ("unreadable", "duplicate", "no calibration or transform")
        return cls(
            heard=int(output["images"]),
            refused=sum(int(output[f"dropped: {cause}"]) for cause in refusals),
            waiting=int(pairing["waiting"]),
            with_radar=int(pairing["paired"]),
            pairs=int(inference["frames in"]),
            out=int(output["frames out"]),
            drops=tuple(int(output[f"dropped: {cause}"]) for cause in CAUSES),
            jumps=int(pairing["backward jumps"]),
        )

    @property
    def is_settled(self) -> bool:
        """Whether each image that came is depth, or dropped with a cause."""
        return not self.waiting and self.heard == self.refused + self.pairs and self.pairs == self.out + sum(self.drops)


@dataclass(frozen=True)
class Round:
    """One pass over the drive.

    Attributes:
        at_s: When it began, since the soak did.
        seconds: How long it was played.
        sent: Images that were published.
        heard: Images that the node got.
        refused: Images that it could not use.
        with_radar: Images that were paired with a sweep.
        pairs: What was handed to the network.
        out: Depth images.
        drops: Pairs that gave no depth, for each of `CAUSES`.
    """

    at_s: float
    seconds: float
    sent: int
    heard: int
    refused: int
    with_radar: int
    pairs: int
    out: int
    drops: tuple[int, ...]

    @classmethod
    def between(cls, before: Counts, after: Counts, at_s: float, seconds: float, sent: int) -> Round:
        """What was counted between two moments at which nothing was under way."""
        return cls(
            at_s,
            seconds,
            sent,
            after.heard - before.heard,
            after.refused - before.refused,
            after.with_radar - before.with_radar,
            after.pairs - before.pairs,
            after.out - before.out,
            tuple(late - early for early, late in zip(before.drops, after.drops, strict=True)),
        )


@dataclass(frozen=True)
class Target:
    """What has to hold.

    Attributes:
        name: Of what.
        value: What came out.
        limit: What was wanted.
        is_held: Whether it is so.
    """

    name: str
    value: str
    limit: str
    is_held: bool


@dataclass(frozen=True)
class Soak:
    """What came out.

    Attributes:
        seconds: How long the node was under overload.
        network_rate: Depth images a second that it gives where images come as fast as it takes them.
        image_rate: Images a second that were published.
        readings: Of its process, in the order of time.
        latencies: Of each depth image: when it came, seconds since the soak began, and the milliseconds from its
            image's arrival in the node to its publication.
        round_trips: The same from the image's publication to the depth's arrival.
        rounds: Each pass over the drive.
        jumps: How often stamps jumped back in the node.
    """

    seconds: float
    network_rate: float
    image_rate: float
    readings: tuple[Reading, ...]
    latencies: tuple[tuple[float, float], ...]
    round_trips: tuple[tuple[float, float], ...]
    rounds: tuple[Round, ...]
    jumps: int

    @property
    def span_s(self) -> float:
        """How long memory has to settle, and how long the spans are whose latency is compared, seconds."""
        return min(SETTLE_S, self.seconds / SHARE_OF_SHORT)

    def settled_and_end(self, name: str) -> tuple[float, float]:
        """The median of a figure of `Reading` just after it settled, and at the end."""
        window_s, end_s = self.span_s / _WINDOWS_OF_SPAN, self.readings[-1].at_s
        first = [reading for reading in self.readings if self.span_s <= reading.at_s <= self.span_s + window_s]
        last = [reading for reading in self.readings if reading.at_s >= end_s - window_s]
        settled, end = (np.median([getattr(reading, name) for reading in part]) for part in (first, last))
        return float(settled), float(end)

    def most(self, name: str) -> float:
        """The highest that a figure of `Reading` was after it settled."""
        return max(float(getattr(reading, name)) for reading in self.readings if reading.at_s >= self.span_s)

    def p99_ms(self, times: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """Of the first span and of the last, milliseconds."""
        return self._p99_ms(times, 0.0), self._p99_ms(times, self.seconds - self.span_s)

    def p99_of_spans_ms(self, times: Sequence[tuple[float, float]]) -> tuple[float, ...]:
        """Of each span, milliseconds: whether a change between first and last is a trend. NaN where no depth came."""
        return tuple(self._p99_ms(times, start_s) for start_s in self._starts_s())

    def stolen_percent(self) -> tuple[float, ...]:
        """Of each span: processor time that the machine's host gave to others, per cent of one core."""
        at_s, stolen_s = ([getattr(reading, name) for reading in self.readings] for name in ("at_s", "stolen_s"))
        starts_s = np.array(self._starts_s())
        gained_s = np.interp(starts_s + self.span_s, at_s, stolen_s) - np.interp(starts_s, at_s, stolen_s)
        return tuple(float(share) for share in 100 * gained_s / self.span_s)

    def _starts_s(self) -> tuple[float, ...]:
        return tuple(number * self.span_s for number in range(int(self.seconds / self.span_s)))

    def _p99_ms(self, times: Sequence[tuple[float, float]], start_s: float) -> float:
        within = [duration_ms for at_s, duration_ms in times if start_s <= at_s <= start_s + self.span_s]
        return float(np.percentile(within, 99)) if within else float("nan")

    def targets(self) -> tuple[Target, ...]:
        """What has to hold, in the order of the issue that asks for it."""
        settled_mib, end_mib = self.settled_and_end("rss_mib")
        growth = 100 * (end_mib / settled_mib - 1)
        first_ms, last_ms = self.p99_ms(self.latencies)
        change = 100 * (last_ms / first_ms - 1)
        pairs = sorted({turn.pairs for turn in self.rounds})
        dropped = min(turn.drops[0] / turn.sent for turn in self.rounds)
        return (
            Target(
                f"memory after {self.span_s:.0f} s",
                f"{growth:+.2f} %",
                f"< {MEMORY_GROWTH_PERCENT:g} %",
                growth < MEMORY_GROWTH_PERCENT,
            ),
            Target(
                f"latency p99, last {self.span_s:.0f} s against first",
                f"{change:+.1f} %",
                f"within {LATENCY_CHANGE_PERCENT:g} %",
                abs(change) <= LATENCY_CHANGE_PERCENT,
            ),
            Target("pairs in a round", _few(pairs), "the same in each", len(pairs) == 1),
            Target("dropped by overload", f">= {100 * dropped:.0f} %", "some in each round", dropped > 0),
            self._unchanged("threads", "threads"),
            self._unchanged("file descriptors", "files"),
        )

    def as_json(self) -> dict[str, Any]:
        """Plain values; memory as at most so many points over time."""
        settled_mib, end_mib = self.settled_and_end("rss_mib")
        step = max(1, -(-len(self.readings) // _POINTS_WRITTEN))
        return {
            "seconds": round(self.seconds, 1),
            "span_s": round(self.span_s, 1),
            "network_rate": round(self.network_rate, 2),
            "image_rate": round(self.image_rate, 2),
            "targets": [vars(target) for target in self.targets()],
            "memory_mib": {
                "settled": round(settled_mib, 2),
                "end": round(end_mib, 2),
                "most": round(self.most("rss_mib"), 2),
            },
            "latency_p99_ms": dict(zip(("first", "last"), _known(self.p99_ms(self.latencies)), strict=True)),
            "round_trip_p99_ms": dict(zip(("first", "last"), _known(self.p99_ms(self.round_trips)), strict=True)),
            "latency_p99_of_spans_ms": _known(self.p99_of_spans_ms(self.latencies)),
            "stolen_percent_of_spans": self.stolen_percent(),
            "backward_jumps": self.jumps,
            "readings": [vars(reading) for reading in (*self.readings[:-1:step], self.readings[-1])],
            "rounds": [{**vars(turn), "drops": dict(zip(CAUSES, turn.drops, strict=True))} for turn in self.rounds],
        }

    def _unchanged(self, name: str, figure: str) -> Target:
        settled, end = self.settled_and_end(figure)
        return Target(
            name, f"{settled:.0f}, then {end:.0f}, at most {self.most(figure):.0f}", "no more", end <= settled
        )


def _known(values: Sequence[float]) -> list[float | None]:
    """For JSON, which has no NaN."""
    return [None if np.isnan(value) else value for value in values]


def _few(numbers: list[int]) -> str:
    return ", ".join(str(number) for number in numbers[:5]) + (" ..." if len(numbers) > 5 else "")
