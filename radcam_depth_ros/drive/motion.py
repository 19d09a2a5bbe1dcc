"""Where a vehicle was at any time, from its odometry or from /tf."""

from __future__ import annotations

import bisect
from typing import Any

import numpy as np

from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive.settings import DriveError
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import decode_odometry, decode_transforms

_MAX_GAP_NS = 500_000_000
"""Between two poses that are further apart nobody knows how the vehicle moved."""


class Motion:
    """Poses of the vehicle over time, filled from a bag's messages.

    Args:
        topics: The bag's: odometry is taken where there is, else /tf.
        transforms: The vehicle's fixed frames. Of /tf's links the one counts whose child is fixed to `anchor`: of
            map -> odom -> base_link that is the second.
        anchor: The camera's frame.

    Attributes:
        base_frame: The frame whose poses these are; None until the first came.
    """

    def __init__(self, topics: SensorTopics, transforms: TransformTree, anchor: str) -> None:
        self.topic = topics.odometry or topics.tf
        self.base_frame: str | None = None
        self._is_odometry = topics.odometry is not None
        self._transforms, self._anchor = transforms, anchor
        self._times_ns: list[int] = []  # ascending
        self._poses: list[RigidTransform] = []

    def accept(self, message: Any) -> None:
        """Takes a message of `topic`."""
        if self._is_odometry:
            reading = decode_odometry(message)
            if not reading.child_frame_id:
                raise DriveError(
                    f"the odometry on {self.topic!r} has an empty child_frame_id, so nobody can tell which frame it "
                    "moves; set it in the driver, name another topic, or leave accumulation out"
                )
            self._add(reading.child_frame_id, reading.stamp_ns, reading.pose)
            return
        for link in decode_transforms(message):
            if self._transforms.can_transform(self._anchor, link.child_frame):
                self._add(link.child_frame, link.stamp_ns, link.parent_from_child)

    def at(self, time_ns: int) -> RigidTransform | None:
        """`world_from_base` at a time; None where it is not known."""
        after = bisect.bisect_left(self._times_ns, time_ns)
        if after < len(self._times_ns) and self._times_ns[after] == time_ns:
            return self._poses[after]
        if not 0 < after < len(self._times_ns):
            return None
        start_ns, end_ns = self._times_ns[after - 1 : after + 1]
        if end_ns - start_ns > _MAX_GAP_NS:
            return None
        return interpolate(self._poses[after - 1], self._poses[after], (time_ns - start_ns) / (end_ns - start_ns))

    def covers(self, time_ns: int) -> bool:
        """Whether a pose of this time or a later one came."""
        return bool(self._times_ns) and self._times_ns[-1] >= time_ns

    def forget_before(self, time_ns: int) -> None:
        """Forgets poses that no time from this one on needs."""
        count = bisect.bisect_right(self._times_ns, time_ns) - 1
        if count > 0:
            del self._times_ns[:count], self._poses[:count]

    def clear(self) -> None:
        """Forgets all poses."""
        self._times_ns.clear()
        self._poses.clear()

    def _add(self, frame: str, time_ns: int, pose: RigidTransform) -> None:
        if self.base_frame is None:
            self.base_frame = frame
        elif frame != self.base_frame:
            return
        index = bisect.bisect_left(self._times_ns, time_ns)
        if index == len(self._times_ns) or self._times_ns[index] != time_ns:
            self._times_ns.insert(index, time_ns)
            self._poses.insert(index, pose)


def interpolate(start: RigidTransform, end: RigidTransform, share: float) -> RigidTransform:
    """The pose a share of the way from one pose to another one nearby."""
    first, last = np.array(start.quaternion), np.array(end.quaternion)
    if first @ last < 0:
        last = -last
    # Normalised by from_quaternion: between poses a few degrees apart that is the great circle to a millidegree.
    quaternion = (1 - share) * first + share * last
    return RigidTransform.from_quaternion((1 - share) * start.translation + share * end.translation, quaternion)
