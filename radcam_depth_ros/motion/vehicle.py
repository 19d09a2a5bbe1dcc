"""Poses of a vehicle over time, from its odometry or from /tf."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.geometry import MAX_LINKS, RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform, decode_odometry, decode_transforms
from radcam_depth_ros.motion.links import EVERYTHING, Memory, MovingLinks

_SECOND = 1_000_000_000
_CONVINCING = 5
"""So many messages of another frame in a row, and it is theirs that counts: the first one was wrong."""


class MotionError(RadcamDepthError):
    """Odometry that does not say what moves, or a time of which nobody knows where the vehicle was."""


def moves(transforms: TransformTree, anchor: str, link: StampedTransform) -> bool:
    """Whether a link of /tf tells how a frame moves: it is fixed to the link's child, and not to its parent as well."""
    parent, child = link.parent_frame.lstrip("/"), link.child_frame.lstrip("/")
    return transforms.can_transform(anchor, child) and not transforms.can_transform(anchor, parent)


class Motion:
    """Poses of the vehicle over time, filled from messages.

    Args:
        topic: Where they come from.
        is_odometry: They are nav_msgs/Odometry, else tf2_msgs/TFMessage.
        transforms: The vehicle's frames.
        anchor: The camera's frame. Of /tf's links the one counts whose child is fixed to it, and whose parent is not:
            of map -> odom -> base_link that is the second.
        odom_frame: A frame that stands still. With it all of /tf's links between it and the anchor count, and must be
            in `transforms` as well.
        memory: How much is kept.

    Attributes:
        base_frame: The frame whose poses these are; None until the first came.
        frame_problem: What is wrong with the frame of the last odometry; empty where that is `base_frame` as before.
    """

    def __init__(
        self,
        topic: str,
        *,
        is_odometry: bool,
        transforms: TransformTree,
        anchor: str,
        odom_frame: str = "",
        memory: Memory = EVERYTHING,
    ) -> None:
        self.topic = topic
        self.anchor = anchor
        self.base_frame: str | None = anchor if odom_frame else None
        self.frame_problem = ""
        self._others: list[str] = []  # frames of the last messages, as far back as they are not the base's
        self._is_odometry, self._transforms = is_odometry, transforms
        self._odom_frame = odom_frame.lstrip("/")
        self._links = MovingLinks(memory)

    def add(self, message: Any) -> None:
        """Takes a message of `topic`.

        Raises:
            RadcamDepthError: for one that cannot be used.
        """
        if not self._is_odometry:
            self.add_links(decode_transforms(message))
            return
        reading = decode_odometry(message)
        if not reading.child_frame_id:
            raise MotionError(
                f"the odometry on {self.topic!r} has an empty child_frame_id, so nobody can tell which frame it moves; "
                "set it in the driver, or name another topic"
            )
        self._judge_frame(reading.child_frame_id)
        self._add_base(reading.frame_id, reading.child_frame_id, reading.stamp_ns, reading.pose)

    def add_links(self, links: Iterable[StampedTransform]) -> None:
        """Takes links of /tf."""
        above = self._above_anchor() if self._odom_frame else ()
        if self._odom_frame and len(self._links) > MAX_LINKS:
            self._links.keep(above)
        for link in links:
            child = link.child_frame.lstrip("/")
            if self._odom_frame:
                if child in above:
                    self._links.add(link.parent_frame.lstrip("/"), child, link.stamp_ns, link.parent_from_child)
            elif moves(self._transforms, self.anchor, link):
                self._add_base(link.parent_frame, child, link.stamp_ns, link.parent_from_child)

    def at(self, time_ns: int) -> RigidTransform | None:
        """`world_from_base` at a time; None where it is not known."""
        if not self._odom_frame:
            return self._links.at(self.base_frame or "", time_ns)
        frame, world_from_base = self.anchor.lstrip("/"), RigidTransform.identity()
        while frame != self._odom_frame:
            fixed = self._transforms.link(frame)
            if fixed is None:
                return None
            parent, parent_from_frame = fixed
            if self._links.has(parent, frame):
                pose = self._links.at(frame, time_ns)
                if pose is None:
                    return None
                parent_from_frame = pose
            frame, world_from_base = parent, parent_from_frame @ world_from_base
        # Where nothing moves on the way, nobody told how the vehicle did.
        return world_from_base if self._links else None

    def covers(self, time_ns: int) -> bool:
        """Whether poses of this time or a later one came."""
        return bool(self._links) and all(span_ns[1] >= time_ns for _, span_ns in self._links.spans_ns)

    def why_unknown(self, time_ns: int) -> str:
        """What is missing where `at` gives None, as a part of a sentence."""
        what = "odometry" if self._is_odometry else f"pose of {self.anchor!r} in {self._odom_frame!r}"
        if not self._links:
            return f"no {what} came on {self.topic}"
        for child, span_ns in self._links.spans_ns:
            if not span_ns[0] <= time_ns <= span_ns[1]:
                apart_s = min(abs(time_ns - limit_ns) for limit_ns in span_ns) / _SECOND
                return f"the poses of {child!r} on {self.topic} are {apart_s:.2f} s away from its time"
        return f"no {what} on {self.topic} is near enough to its time"

    def forget_before(self, time_ns: int) -> None:
        """Forgets poses that no time from this one on needs."""
        self._links.forget_before(time_ns)

    def clear(self) -> None:
        """Forgets all poses."""
        self._links.clear()

    def _above_anchor(self) -> tuple[str, ...]:
        """The frames from the anchor up to below the one that stands still; none where that is not above it."""
        frames: list[str] = []
        frame = self.anchor.lstrip("/")
        while frame != self._odom_frame:
            frames.append(frame)
            link = self._transforms.link(frame)
            if link is None:
                return ()
            frame = link[0]
        return tuple(frames)

    def _judge_frame(self, frame: str) -> None:
        """Lets go of the frame of the first messages where those that follow are all of another one."""
        if self.base_frame in (None, frame):
            self.frame_problem = ""
            self._others.clear()
            return
        self.frame_problem = (
            f"expected odometry of one frame on {self.topic}, got child_frame_id {frame!r} after {self.base_frame!r}; "
            f"the one that comes {_CONVINCING} times in a row counts; look for a second publisher, or mend the driver"
        )
        if self._others and self._others[-1] != frame:
            self._others.clear()
        self._others.append(frame)
        if len(self._others) == _CONVINCING:
            self._others.clear()
            self._links.clear()
            self.base_frame = frame

    def _add_base(self, parent: str, frame: str, time_ns: int, pose: RigidTransform) -> None:
        if self.base_frame is None:
            self.base_frame = frame
        if frame == self.base_frame:
            self._links.add(parent, frame, time_ns, pose)
