"""Pairs each image with the nearest sweep of each radar, as soon as the choice is final."""

from __future__ import annotations

import bisect
from collections import Counter, deque
from dataclasses import dataclass
from typing import Generic

from radcam_depth_ros.pairing.sweeps import Sweeps
from radcam_depth_ros.pairing.timeline import Timeline
from radcam_depth_ros.pairing.values import (
    EarlierSweep,
    ImageT,
    Pair,
    PairingConfig,
    PairingCounts,
    PairingError,
    RadarCounts,
    SweepT,
    for_each_radar,
)
from radcam_depth_ros.setting import can_adjust, live_settings

_SECOND = 1_000_000_000
_MIN_JUMP_NS = _SECOND // 10
_OFFSETS_KEPT = 256
_IMAGES_KEPT = 64
"""So many images wait at most; so many are remembered to recognise duplicates and sweeps that come late."""

DEFAULTS = PairingConfig()


@dataclass(frozen=True)
class _Waiting(Generic[ImageT]):
    time_ns: int
    stamp_ns: int
    image: ImageT
    arrived_ns: int
    deadline_ns: int


@dataclass(frozen=True)
class _Released:
    time_ns: int
    chosen_ns: tuple[int | None, ...]


class Pairer(Generic[ImageT, SweepT]):
    """Pairs the images of one camera with the sweeps of its radars.

    An image waits `max_wait` at most, counted from its arrival. It gets, of each radar, the sweep that is nearest in
    time among all that come until then, in whatever order; so it gets the true nearest one whenever that comes in time.
    Most images wait less: a pair is released once no sweep still to come can be nearer (`Sweeps` says when).

    Pairs come in the order of their stamps. Two exceptions: an image that comes when a later one is released already,
    and one whose wait ends while an earlier one, which came after it, still waits.

    Where stamps jump backwards (a looped bag, a reset clock) no pair reaches across the jump (`Timeline` says how);
    images from before it wait for their own sweeps as always.

    All `now_ns` are arrival times on one clock that never runs backwards, in nanoseconds; it need not be the clock of
    the stamps. Memory is bounded.

    Where several sweeps are wanted, those before the nearest come along: as they are there when the pair is released,
    so an image does not wait for one that is late.

    Args:
        radars: A name for each radar; without any, images go straight through.
        config: The limits.

    Raises:
        PairingError: for a radar that is named twice, or time offsets of another number of radars.
    """

    def __init__(self, radars: tuple[str, ...], config: PairingConfig = DEFAULTS) -> None:
        if len(set(radars)) != len(radars):
            raise PairingError(f"each radar may be named once, got {', '.join(radars)}; remove the second one")
        self._radars = radars
        self._config = config
        self._max_wait_ns = round(config.max_wait_s * _SECOND)
        offsets_s = for_each_radar("radar_time_offset_s", config.radar_time_offset_s, len(radars))
        self._radar_offsets_ns = tuple(round(offset_s * _SECOND) for offset_s in offsets_s)
        self._earlier_count = config.radar_sweeps - 1
        self._sweeps: tuple[Sweeps[SweepT], ...] = tuple(Sweeps(*_sweep_limits_ns(config)) for _ in radars)
        self._timeline = Timeline(1 + len(radars), _jump_ns(config))
        self._waiting: list[_Waiting[ImageT]] = []  # by time
        self._released: deque[_Released] = deque(maxlen=_IMAGES_KEPT)
        self._now_ns: int | None = None
        self._images: Counter[str] = Counter()
        self._of_radar: tuple[Counter[str], ...] = tuple(Counter() for _ in radars)
        self._offsets_s: tuple[deque[float], ...] = tuple(deque(maxlen=_OFFSETS_KEPT) for _ in radars)
        self._waits_s: deque[float] = deque(maxlen=_OFFSETS_KEPT)

    def adjust(self, config: PairingConfig) -> None:
        """Takes other limits from now on; images that wait do so as long as they were to.

        Raises:
            PairingError: when more than live settings differs.
        """
        if not can_adjust(self._config, config):
            names = ", ".join(live_settings(config))
            raise PairingError(f"only {names} can change while images are paired; make a new pairer")
        self._config = config
        self._max_wait_ns = round(config.max_wait_s * _SECOND)
        for sweeps in self._sweeps:
            sweeps.limit(*_sweep_limits_ns(config))
        self._timeline.jump_ns = _jump_ns(config)

    @property
    def counts(self) -> PairingCounts:
        """What became of everything so far."""
        released = self._images["released"]
        return PairingCounts(
            images=released + len(self._waiting),
            waiting=len(self._waiting),
            paired=self._images["paired"],
            unmatched=released - self._images["paired"],
            overtaken=self._images["overtaken"],
            duplicates=self._images["duplicates"],
            resets=self._timeline.resets,
            radars=tuple(
                RadarCounts(name, count["paired"], released - count["paired"], count["late"], count["duplicates"])
                for name, count in zip(self._radars, self._of_radar, strict=True)
            ),
        )

    @property
    def offsets_s(self) -> tuple[tuple[float, ...], ...]:
        """Of each radar: stamps of the last sweeps that were taken, corrected, minus the images', seconds."""
        return tuple(tuple(offsets_s) for offsets_s in self._offsets_s)

    @property
    def waits_s(self) -> tuple[float, ...]:
        """How long the last images waited for sweeps, seconds."""
        return tuple(self._waits_s)

    @property
    def resets(self) -> int:
        """How often stamps jumped backwards so far."""
        return self._timeline.resets

    @property
    def deadline_ns(self) -> int | None:
        """When `expire` will release an image, on the clock of `now_ns`; None while none waits."""
        return min((waiting.deadline_ns for waiting in self._waiting), default=None)

    def add_image(self, stamp_ns: int, image: ImageT, now_ns: int) -> tuple[Pair[ImageT, SweepT], ...]:
        """Takes an image; returns the pairs that are ready."""
        now_ns = self._advance(now_ns)
        ready = self._release(expired_before_ns=now_ns)
        time_ns = self._timeline.unwrap(0, stamp_ns, now_ns)
        known_ns = [item.time_ns for item in self._waiting] + [item.time_ns for item in self._released]
        if time_ns in known_ns:
            self._images["duplicates"] += 1
            return ready
        waiting = _Waiting(time_ns, stamp_ns, image, now_ns, now_ns + self._max_wait_ns)
        bisect.insort(self._waiting, waiting, key=lambda item: item.time_ns)
        if len(self._waiting) > _IMAGES_KEPT:
            ready += (self._pair(self._waiting.pop(0)),)
        return ready + self._release(expired_before_ns=now_ns if self._max_wait_ns else now_ns + 1)

    def add_sweep(self, radar: str, stamp_ns: int, sweep: SweepT, now_ns: int) -> tuple[Pair[ImageT, SweepT], ...]:
        """Takes a sweep of a radar; returns the pairs that are ready.

        Raises:
            PairingError: for a radar that the pairer was not made with.
        """
        if radar not in self._radars:
            raise PairingError(f"there is no radar {radar!r} to pair, only {', '.join(self._radars) or 'none'}")
        index = self._radars.index(radar)
        sweeps, count = self._sweeps[index], self._of_radar[index]
        now_ns = self._advance(now_ns)
        ready = self._release(expired_before_ns=now_ns)
        time_ns = self._timeline.unwrap(1 + index, stamp_ns + self._radar_offsets_ns[index], now_ns)
        if not sweeps.add(time_ns, sweep, now_ns):
            count["duplicates"] += 1
        elif any(sweeps.is_nearer(time_ns, item.time_ns, item.chosen_ns[index]) for item in self._released):
            count["late"] += 1
        return ready + self._release(expired_before_ns=now_ns)

    def expire(self, now_ns: int) -> tuple[Pair[ImageT, SweepT], ...]:
        """Returns the images whose wait is over by now, with what they have."""
        return self._release(expired_before_ns=self._advance(now_ns) + 1)

    def flush(self) -> tuple[Pair[ImageT, SweepT], ...]:
        """Returns all images that still wait, with what they have: nothing more will come."""
        waiting, self._waiting = self._waiting, []
        return tuple(self._pair(item) for item in waiting)

    def _advance(self, now_ns: int) -> int:
        self._now_ns = now_ns if self._now_ns is None else max(now_ns, self._now_ns)
        for sweeps in self._sweeps:
            sweeps.advance(self._now_ns)
        return self._now_ns

    def _release(self, expired_before_ns: int) -> tuple[Pair[ImageT, SweepT], ...]:
        # "Before", since what comes at the very deadline still counts.
        ready: list[Pair[ImageT, SweepT]] = []
        kept: list[_Waiting[ImageT]] = []
        for waiting in self._waiting:
            is_final = not kept and all(sweeps.is_final(waiting.time_ns) for sweeps in self._sweeps)
            if is_final or waiting.deadline_ns < expired_before_ns:
                ready.append(self._pair(waiting))
            else:
                kept.append(waiting)
        self._waiting = kept
        return tuple(ready)

    def _pair(self, waiting: _Waiting[ImageT]) -> Pair[ImageT, SweepT]:
        found = [sweeps.nearest(waiting.time_ns) for sweeps in self._sweeps]
        offsets_s = tuple(None if item is None else (item[0] - waiting.time_ns) / _SECOND for item in found)
        for offset_s, count, kept_s in zip(offsets_s, self._of_radar, self._offsets_s, strict=True):
            if offset_s is not None:
                count["paired"] += 1
                kept_s.append(offset_s)
        self._images["released"] += 1
        self._waits_s.append(((self._now_ns or waiting.arrived_ns) - waiting.arrived_ns) / _SECOND)
        self._images["paired"] += any(item is not None for item in found)
        self._images["overtaken"] += any(
            0 < item.time_ns - waiting.time_ns <= self._timeline.jump_ns for item in self._released
        )
        self._released.append(_Released(waiting.time_ns, tuple(None if item is None else item[0] for item in found)))
        return Pair(
            waiting.stamp_ns,
            waiting.image,
            tuple(None if item is None else item[1] for item in found),
            offsets_s,
            tuple(
                () if item is None else self._earlier(sweeps, item[0], waiting.time_ns)
                for sweeps, item in zip(self._sweeps, found, strict=True)
            )
            if self._earlier_count
            else (),
        )

    def _earlier(self, sweeps: Sweeps[SweepT], chosen_ns: int, image_ns: int) -> tuple[EarlierSweep[SweepT], ...]:
        return tuple(
            EarlierSweep(sweep, (time_ns - image_ns) / _SECOND)
            for time_ns, sweep in sweeps.before(chosen_ns, image_ns, self._earlier_count)
        )


def _sweep_limits_ns(config: PairingConfig) -> tuple[int, int, int]:
    """Of `Sweeps`: how far away a sweep may be, how long one is waited for, how old earlier ones may be."""
    limits_s = (config.max_time_offset_s, config.max_wait_s, config.max_sweep_age_s if config.radar_sweeps > 1 else 0.0)
    offset_ns, wait_ns, age_ns = (round(limit_s * _SECOND) for limit_s in limits_s)
    return offset_ns, wait_ns, age_ns


def _jump_ns(config: PairingConfig) -> int:
    # What comes within the wait is at most that much behind; the rest is room for streams that keep it less well.
    return max(round(config.max_wait_s * _SECOND) + round(config.max_time_offset_s * _SECOND), _MIN_JUMP_NS)
