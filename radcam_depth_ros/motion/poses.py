"""Poses of one frame in another over time."""

from __future__ import annotations

import bisect

import numpy as np

from radcam_depth_ros.geometry import RigidTransform

MAX_GAP_NS = 500_000_000
"""Between two poses that are further apart nobody knows how the vehicle moved."""


class Poses:
    """Poses by time, and those in between.

    Args:
        kept: At most so many, the last ones; None keeps all.
    """

    def __init__(self, kept: int | None = None) -> None:
        self._kept = kept
        self._times_ns: list[int] = []  # ascending
        self._poses: list[RigidTransform] = []

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times of the first and of the last pose; None where there is none."""
        return (self._times_ns[0], self._times_ns[-1]) if self._times_ns else None

    def add(self, time_ns: int, pose: RigidTransform) -> None:
        """Takes a pose, in any order; of two of the same time the first one stays."""
        index = bisect.bisect_left(self._times_ns, time_ns)
        if index == len(self._times_ns) or self._times_ns[index] != time_ns:
            self._times_ns.insert(index, time_ns)
            self._poses.insert(index, pose)
            if self._kept is not None and len(self._times_ns) > self._kept:
                del self._times_ns[0], self._poses[0]

    def at(self, time_ns: int, reach_ns: int = 0) -> RigidTransform | None:
        """The pose at a time; None where it is not known.

        Args:
            time_ns: When.
            reach_ns: After the last pose, no longer than this, everything goes on as it moved for as long before.
        """
        after = bisect.bisect_left(self._times_ns, time_ns)
        if after < len(self._times_ns) and self._times_ns[after] == time_ns:
            return self._poses[after]
        if after == 0:
            return None
        if after == len(self._times_ns):
            return self._beyond(time_ns - self._times_ns[-1], reach_ns)
        start_ns, end_ns = self._times_ns[after - 1 : after + 1]
        if end_ns - start_ns > MAX_GAP_NS:
            return None
        return interpolate(self._poses[after - 1], self._poses[after], (time_ns - start_ns) / (end_ns - start_ns))

    def nearest(self, time_ns: int) -> RigidTransform | None:
        """The pose of the nearest time, of two the earlier; None where there is none."""
        after = bisect.bisect_left(self._times_ns, time_ns)
        around = [index for index in (after - 1, after) if 0 <= index < len(self._times_ns)]
        index = min(around, key=lambda index: abs(self._times_ns[index] - time_ns), default=None)
        return None if index is None else self._poses[index]

    def _beyond(self, ahead_ns: int, reach_ns: int) -> RigidTransform | None:
        # As long a time before, not the last two poses: their noise would grow with how close together they are.
        before = self.at(self._times_ns[-1] - ahead_ns) if ahead_ns <= reach_ns else None
        return None if before is None else self._poses[-1] @ (before.inverse() @ self._poses[-1])

    def forget_before(self, time_ns: int) -> None:
        """Forgets poses that no time from this one on needs."""
        count = bisect.bisect_right(self._times_ns, time_ns) - 1
        if count > 0:
            del self._times_ns[:count], self._poses[:count]


def interpolate(start: RigidTransform, end: RigidTransform, share: float) -> RigidTransform:
    """The pose a share of the way from one pose to another one nearby."""
    first, last = np.array(start.quaternion), np.array(end.quaternion)
    if first @ last < 0:
        last = -last
    # Normalised by from_quaternion: between poses a few degrees apart that is the great circle to a millidegree.
    quaternion = (1 - share) * first + share * last
    return RigidTransform.from_quaternion((1 - share) * start.translation + share * end.translation, quaternion)
