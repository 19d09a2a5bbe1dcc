"""The clock by which messages arrive."""

from __future__ import annotations

import time

from rclpy.clock import ROSClock
from rclpy.node import Node


class ArrivalClock:
    """Nanoseconds that never go back, for how long an image waits for its radar sweeps.

    That is the steady clock; with `use_sim_time` it runs as `/clock` does, so that pairing is the same at any playback
    rate and stands still with it. When simulated time jumps back, as in a looped bag, this clock goes on from where it
    is.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._now_ns = 0
        self._last: tuple[bool, int] | None = None

    def now_ns(self) -> int:
        """The time now."""
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        reading_ns = self._clock.now().nanoseconds if simulated else time.monotonic_ns()
        if self._last is not None and self._last[0] == simulated:
            self._now_ns += max(reading_ns - self._last[1], 0)
        self._last = (simulated, reading_ns)
        return self._now_ns
