"""Statistics of a sensor's stamps: their offset from the camera's, and the share that is missing."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from radcam_depth_ros.node.health import SECOND_NS

_KEPT = 128
_ENOUGH = 5
_FRESH_NS = SECOND_NS
"""An image that came longer ago is not compared with."""
_LONGEST_GAP = 10
"""A gap of so many intervals is a pause or a jump; what is shorter is lost messages."""


class SensorStamps:
    """The stamps of one sensor's last messages.

    Attributes:
        newest_ns: Stamp and arrival of the last message, nanoseconds; None before the first.
    """

    def __init__(self) -> None:
        self.newest_ns: tuple[int, int] | None = None
        self._stamps_ns: deque[int] = deque(maxlen=_KEPT)

    def add(self, stamp_ns: int, arrived_ns: int) -> None:
        """Takes a message's stamp, and when it came on a steady clock."""
        self.newest_ns = (stamp_ns, arrived_ns)
        self._stamps_ns.append(stamp_ns)

    @property
    def are_unset(self) -> bool:
        """Whether the last two stamps are 0; one alone is that of a simulation's beginning."""
        return len(self._stamps_ns) > 1 and not (self._stamps_ns[-1] or self._stamps_ns[-2])

    def missing_share(self) -> float | None:
        """Of the messages that a steady sensor would have sent, the share that is not there; None of a few messages."""
        intervals_ns = np.diff(np.unique(np.array(self._stamps_ns, np.int64)))
        if len(intervals_ns) < _ENOUGH:
            return None
        steps = np.rint(intervals_ns / np.median(intervals_ns))
        steps = steps[(steps > 0) & (steps < _LONGEST_GAP)]
        return float(1 - len(steps) / steps.sum()) if len(steps) else None


class StampOffset:
    """How far a radar's stamps are ahead of the camera's, where messages that come together were taken together."""

    def __init__(self) -> None:
        self._samples_ns: deque[int] = deque(maxlen=_KEPT)

    def add(self, stamp_ns: int, arrived_ns: int, image: SensorStamps) -> None:
        """Takes a sweep's stamp and arrival, nanoseconds, beside the image that came last."""
        if image.newest_ns is not None and arrived_ns - image.newest_ns[1] <= _FRESH_NS:
            image_ns, image_arrived_ns = image.newest_ns
            self._samples_ns.append((stamp_ns - arrived_ns) - (image_ns - image_arrived_ns))

    def seconds(self) -> float | None:
        """The median; None of a few sweeps."""
        return float(np.median(self._samples_ns)) / SECOND_NS if len(self._samples_ns) >= _ENOUGH else None

    def apart_s(self, limit_s: float, added_s: float = 0.0) -> float | None:
        """The median and what is added, where that is beyond a limit and clearly more than arrivals vary; else None."""
        median_s = self.seconds()
        if median_s is None or abs(median_s + added_s) <= limit_s:
            return None
        offset_s = median_s + added_s
        spread_ns = float(np.subtract(*np.percentile(self._samples_ns, (90, 10))))
        return offset_s if spread_ns < abs(offset_s) * SECOND_NS / 4 else None


class LostMessages:
    """Counts messages that were published and never came, by the publisher's numbers.

    A middleware's queue drops the oldest message silently while nobody takes any. Of several publishers on a topic the
    numbers cannot be told apart, so that nothing is counted.

    Attributes:
        count: So many were lost.
    """

    def __init__(self) -> None:
        self.count = 0
        self._last: int | None = None

    def add(self, number: int | None, publishers: Callable[[], int]) -> None:
        """Takes a message's number, None where the middleware gives none.

        Args:
            number: The number.
            publishers: How many there are; asked where numbers were left out.
        """
        last, self._last = self._last, number or None
        # A lower number is of a publisher that began anew.
        if number and last is not None and number > last + 1:
            if publishers() == 1:
                self.count += number - last - 1
            else:
                self._last = None
