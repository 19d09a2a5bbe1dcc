"""Chooses the number of a network's threads on a computer that does other work as well.

The threads of a network wait for each other hundreds of times a frame. One that has no core then holds up all others:
on two cores beside one busy process a frame takes five times as long in two threads, in one less than twice as long.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from radcam_depth_ros.engine.load import Load

WAITED_SHARE = 0.25
"""A frame whose threads waited so much of its time for a core, all together, is suspect."""

LEAST_S = 0.1
"""How busy others are can be told over this time: /proc counts in hundredths of a second."""

WINDOW_S = 0.5
"""Others must have left a core free for so long before another thread takes it."""

SPARE = 0.4
"""A core that others use less than this counts as free."""

LONGEST_HOLD_S = 8.0
"""After threads were too many again and again, they stay fewer for at most this time."""


@dataclass
class ThreadBudget:
    """Says before each frame how many threads to take, and is told after it.

    Fewer as soon as threads wait for a core and others are seen to use it; more again when others have left cores free
    for a while, which shows without trying. Each time that more proves too many soon, the next try waits twice as long.

    Args:
        most: Threads on an idle computer.
        cores: Cores that the process may run on, whatever its quota.
        read: What the computer says now.
    """

    most: int
    cores: int
    read: Callable[[], Load] = Load.now

    def __post_init__(self) -> None:
        self.threads = self.most
        self._began = self._window = self.read()
        self._suspected: Load | None = None
        self._hold_s = WINDOW_S
        self._raised_s = self._held_until_s = -math.inf

    def begin(self) -> int:
        """Begins a frame; the number of threads for it."""
        now = self.read()
        if now.at_s - self._window.at_s >= WINDOW_S:
            free = self._free(self._window, now)
            self._window = now
            if free > self.threads and now.at_s >= self._held_until_s:
                self.threads, self._raised_s = free, now.at_s
        self._began = now
        return self.threads

    def end(self) -> None:
        """Ends the frame that was begun last."""
        now = self.read()
        waited_s, took_s = now.waited_s - self._began.waited_s, now.at_s - self._began.at_s
        # Never where the system does not tell: NaN is not more.
        if self.threads == 1 or not waited_s > WAITED_SHARE * took_s:
            self._suspected = None
            return
        self._suspected = self._suspected or self._began
        if now.at_s - self._suspected.at_s >= LEAST_S:
            free = self._free(self._suspected, now)
            self._suspected = None
            if free < self.threads:
                self._take_fewer(free, now)

    def _take_fewer(self, threads: int, now: Load) -> None:
        # Still fewer while they are held has the same cause: it does not count twice.
        if now.at_s >= self._held_until_s:
            was_soon = now.at_s - self._raised_s < LONGEST_HOLD_S
            self._hold_s = min(2 * self._hold_s, LONGEST_HOLD_S) if was_soon else WINDOW_S
        self.threads, self._window, self._held_until_s = threads, now, now.at_s + self._hold_s

    def _free(self, since: Load, now: Load) -> int:
        """Cores that others have left free, at most as many as there may be threads."""
        others = ((now.busy_s - since.busy_s) - (now.own_s - since.own_s)) / (now.at_s - since.at_s)
        if math.isnan(others):
            return self.most
        return max(1, min(self.most, math.floor(self.cores - others + SPARE)))
