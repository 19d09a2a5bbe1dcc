"""Moving links of a transform tree over time."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.motion.poses import Poses


@dataclass(frozen=True)
class Memory:
    """How much of what moves is kept, and how far it is believed. Without any of it: all of it, as it is.

    Attributes:
        reach_ns: So long after its last pose something goes on as it moved before.
        jump_ns: A pose that is further behind the newest one than this begins anew: a looped bag, a reset clock.
        kept: So many poses are kept at most.
    """

    reach_ns: int = 0
    jump_ns: int | None = None
    kept: int | None = None


EVERYTHING = Memory()


class MovingLinks:
    """Where frames were in their parents.

    Args:
        memory: How much is kept.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._links: dict[str, tuple[str, Poses]] = {}  # by child: its parent, and where it was in it

    def __len__(self) -> int:
        return len(self._links)

    @property
    def spans_ns(self) -> tuple[tuple[str, tuple[int, int]], ...]:
        """Each child with the times of its first and of its last pose."""
        return tuple((child, poses.span_ns) for child, (_, poses) in self._links.items() if poses.span_ns)

    def add(self, parent: str, child: str, time_ns: int, pose: RigidTransform) -> None:
        """Takes `parent_from_child` at a time; forgets all links where time has jumped backwards."""
        link = self._links.get(child)
        span_ns = link[1].span_ns if link is not None else None
        jump_ns = self._memory.jump_ns
        if span_ns is not None and jump_ns is not None and time_ns < span_ns[1] - jump_ns:
            self.clear()
            link = None
        if link is None or link[0] != parent:
            link = self._links[child] = (parent, Poses(self._memory.kept))
        link[1].add(time_ns, pose)

    def has(self, parent: str, child: str) -> bool:
        """Whether a child moves in this parent."""
        link = self._links.get(child)
        return link is not None and link[0] == parent

    def at(self, child: str, time_ns: int) -> RigidTransform | None:
        """`parent_from_child` at a time; None where it is not known."""
        link = self._links.get(child)
        return None if link is None else link[1].at(time_ns, self._memory.reach_ns)

    def nearest(self, child: str, time_ns: int) -> RigidTransform | None:
        """`parent_from_child` as it was told for the time that is nearest; None where it never was."""
        link = self._links.get(child)
        return None if link is None else link[1].nearest(time_ns)

    def forget(self, child: str) -> None:
        """Forgets a link, where it is known."""
        self._links.pop(child, None)

    def keep(self, children: Container[str]) -> None:
        """Forgets all links but those of these children."""
        self._links = {child: link for child, link in self._links.items() if child in children}

    def forget_before(self, time_ns: int) -> None:
        """Forgets poses that no time from this one on needs."""
        for _, poses in self._links.values():
            poses.forget_before(time_ns)

    def clear(self) -> None:
        """Forgets all of them."""
        self._links.clear()
