"""Holds the last sweeps of one radar: finds the nearest to an image, and whether a nearer one may still come."""

from __future__ import annotations

import bisect
from collections import deque
from typing import Generic

from radcam_depth_ros.pairing.values import SweepT

_SECOND = 1_000_000_000
_GAPS_NEEDED = 10
_GAPS_KEPT = 64
_IN_ORDER_NEEDED = 100
"""After so many sweeps in a row that came in the order of their times, the next ones are taken to do so as well."""
_SWEEPS_KEPT = 16
"""So many are kept however old they are, for a bag that is played slowly."""
_MAX_SWEEPS_KEPT = 256


class Sweeps(Generic[SweepT]):
    """Sweeps in the order of their times, and what is known of the gaps between them.

    `is_final` rests on m, a time no longer than any gap between two sweeps. A sweep still to come is then at least m
    away from each that came. If x is the distance of the nearest that came, a nearer one lies inside of (image - x,
    image + x), m or more after the last sweep before the image and m or more before the first one after it. Where that
    leaves no place the choice is final: when 2 x < m, or when the sweeps around the image are less than 2 m apart,
    which makes them neighbours. The order of arrival does not matter for this.

    A radar whose sweeps have long come in the order of their times, as those of one publisher do, is taken to go on so:
    the choice is final, too, once a sweep after the image came. Of a radar that jitters m is small, and images would
    mostly wait in vain for one that might come between. The first sweep out of order ends that for a while, and can
    mislead one image, which `late` shows.

    m is three quarters of the shortest of the last gaps. A gap counts once `max_wait` has passed since its later sweep
    came, so that none that is still under way can divide it. Until enough gaps are known, m is next to nothing and
    images wait. So what is assumed is that no gap is shorter than three quarters of the shortest of many before it.
    Gaps that stay within a seventh of the period always are so: 3/4 of 8/7 is 6/7. A radar that jitters more shows
    shorter gaps, m shrinks with them, and images wait longer. A lost sweep makes a gap longer, which changes nothing.
    A radar that suddenly sweeps much faster can mislead until its first gaps count, and `late` shows it.

    Args:
        max_offset_ns: A sweep further away from an image than this is not its.
        max_wait_ns: A sweep comes no more than this after one that was taken later.
        max_age_ns: An image may ask for sweeps that are older than it by this, see `before`.
    """

    def __init__(self, max_offset_ns: int, max_wait_ns: int, max_age_ns: int = 0) -> None:
        self.limit(max_offset_ns, max_wait_ns, max_age_ns)
        self._times_ns: list[int] = []  # ascending
        self._sweeps: list[SweepT] = []
        self._arrivals: deque[tuple[int, int]] = deque()  # when it came, and its time, in the order in which they came
        self._unmeasured: deque[tuple[int, int]] = deque(maxlen=_MAX_SWEEPS_KEPT)  # the same; their gaps do not count
        self._gaps_ns: deque[int] = deque(maxlen=_GAPS_KEPT)
        self._spacing_ns = 1  # m
        self._in_order = 0  # so many sweeps in a row came in order

    def limit(self, max_offset_ns: int, max_wait_ns: int, max_age_ns: int) -> None:
        """Sets the limits, from now on, to others."""
        self._max_offset_ns = max_offset_ns
        self._max_wait_ns = max_wait_ns
        self._max_age_ns = max_age_ns
        self._keep_ns = _SECOND + 2 * (max_wait_ns + max_offset_ns) + max_age_ns

    def add(self, time_ns: int, sweep: SweepT, now_ns: int) -> bool:
        """Takes a sweep that came at `now_ns`; False for one whose time is there already, which is dropped."""
        index = bisect.bisect_left(self._times_ns, time_ns)
        if index < len(self._times_ns) and self._times_ns[index] == time_ns:
            return False
        self._in_order = self._in_order + 1 if self._arrivals and self._arrivals[-1][1] < time_ns else 0
        self._times_ns.insert(index, time_ns)
        self._sweeps.insert(index, sweep)
        self._arrivals.append((now_ns, time_ns))
        self._unmeasured.append((now_ns, time_ns))
        return True

    def advance(self, now_ns: int) -> None:
        """Measures the gaps that nothing under way can divide any more, and forgets old sweeps."""
        measured = False
        while self._unmeasured and self._unmeasured[0][0] + self._max_wait_ns < now_ns:
            index = bisect.bisect_left(self._times_ns, self._unmeasured.popleft()[1])
            if 0 < index < len(self._times_ns):
                self._gaps_ns.append(self._times_ns[index] - self._times_ns[index - 1])
                measured = True
        if measured and len(self._gaps_ns) >= _GAPS_NEEDED:
            self._spacing_ns = max(1, 3 * min(self._gaps_ns) // 4)
        while self._has_too_old(now_ns):
            index = bisect.bisect_left(self._times_ns, self._arrivals.popleft()[1])
            del self._times_ns[index], self._sweeps[index]

    def nearest(self, image_ns: int) -> tuple[int, SweepT] | None:
        """Time and sweep nearest to an image, of two the earlier; None where none is near enough."""
        after = bisect.bisect_left(self._times_ns, image_ns)
        around = [index for index in (after - 1, after) if 0 <= index < len(self._times_ns)]
        index = min(around, key=lambda index: abs(self._times_ns[index] - image_ns), default=None)
        if index is None or abs(self._times_ns[index] - image_ns) > self._max_offset_ns:
            return None
        return self._times_ns[index], self._sweeps[index]

    def before(self, chosen_ns: int, image_ns: int, count: int) -> tuple[tuple[int, SweepT], ...]:
        """Time and sweep of those before the one that was chosen for an image, the newest first, `count` at most."""
        end = bisect.bisect_left(self._times_ns, chosen_ns)
        start = max(end - count, bisect.bisect_left(self._times_ns, image_ns - self._max_age_ns), 0)
        return tuple((self._times_ns[index], self._sweeps[index]) for index in range(end - 1, start - 1, -1))

    def is_nearer(self, time_ns: int, image_ns: int, chosen_ns: int | None) -> bool:
        """Whether a sweep would be taken for an image instead of the one that was."""
        distance_ns = abs(time_ns - image_ns)
        if chosen_ns is None:
            return distance_ns <= self._max_offset_ns
        return (distance_ns, time_ns) < (abs(chosen_ns - image_ns), chosen_ns)

    def is_final(self, image_ns: int) -> bool:
        """Whether no sweep that is still to come would be taken instead of the nearest; see the class."""
        first_ns, last_ns = image_ns - self._max_offset_ns, image_ns + self._max_offset_ns  # where it would have to be
        nearest = self.nearest(image_ns)
        if nearest is not None:
            distance_ns = abs(nearest[0] - image_ns)
            # Of two at the same distance the earlier is taken, so before the image that is near enough.
            first_ns, last_ns = image_ns - distance_ns, image_ns + distance_ns - 1
        after = bisect.bisect_left(self._times_ns, image_ns)
        if after < len(self._times_ns) and self._in_order >= _IN_ORDER_NEEDED:
            return True
        if after > 0:
            first_ns = max(first_ns, self._times_ns[after - 1] + self._spacing_ns)
        if after < len(self._times_ns):
            last_ns = min(last_ns, self._times_ns[after] - self._spacing_ns)
        return first_ns > last_ns

    def _has_too_old(self, now_ns: int) -> bool:
        count = len(self._arrivals)
        is_old = count > _SWEEPS_KEPT and self._arrivals[0][0] + self._keep_ns < now_ns
        return is_old or count > _MAX_SWEEPS_KEPT
