"""Clock of message arrival, which follows `/clock` under simulated time and never goes back."""

from __future__ import annotations

import time

from rclpy.clock import ROSClock
from rclpy.node import Node

LEAP_NS = 60_000_000_000
"""No playback is so fast, and no callback so slow, that `/clock` goes on as much between two looks at it."""


class ArrivalClock:
    """Nanoseconds that never go back, for how long an image waits for its radar sweeps.

    That is the steady clock; with `use_sim_time` it runs as `/clock` does, so that pairing is the same at any playback
    rate and stands still with it. When simulated time jumps back, as in a looped bag, this clock goes on from where it
    is.

    Attributes:
        leaps: How often simulated time leapt ahead by more than `LEAP_NS`.
        last_leap_ns: By how much it did so the last time.
    """

    def __init__(self, node: Node) -> None:
        self.leaps = 0
        self.last_leap_ns = 0
        self._clock = node.get_clock()
        self._now_ns = 0
        self._last: tuple[bool, int] | None = None

    def now_ns(self) -> int:
        """The time now."""
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        reading_ns = self._clock.now().nanoseconds if simulated else time.monotonic_ns()
        if self._last is not None and self._last[0] == simulated:
            step_ns = reading_ns - self._last[1]
            self._now_ns += max(step_ns, 0)
            # Simulated time is 0 until the first message on /clock.
            if simulated and self._last[1] and step_ns > LEAP_NS:
                self.leaps, self.last_leap_ns = self.leaps + 1, step_ns
        self._last = (simulated, reading_ns)
        return self._now_ns
