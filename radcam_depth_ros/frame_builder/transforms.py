"""Takes transforms of `/tf_static` and `/tf`, notes where they disagree, and forgets frames that are too many."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from radcam_depth_ros.geometry import MAX_LINKS, RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform
from radcam_depth_ros.motion import Mounts

JUMP_M, JUMP_DEG = 0.1, 1.0
"""From here on a static transform that comes again is another one; drivers round."""


class TransformIntake:
    """Fills a transform tree.

    A frame that `/tf_static` places is placed by it alone: what `/tf` says of it is left out. A static transform may
    come again, and jump: it is followed, or refused.

    Where there are `MAX_LINKS` frames, a new one takes the place of the one that was heard of longest ago: of those on
    `/tf`, else of those on `/tf_static`. Links that join the needed frames stay.

    Args:
        transforms: The tree.
        mounts: Told of the links of `/tf` that are taken, and of frames that are forgotten.
        needed: Gives the frames that are looked up.
        refuses_jumps: Static transforms keep their first value for good.
    """

    def __init__(
        self,
        transforms: TransformTree,
        mounts: Mounts,
        *,
        refuses_jumps: bool,
        needed: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        self._transforms = transforms
        self._mounts = mounts
        self._refuses_jumps = refuses_jumps
        self._needed = needed
        # Both in the order in which they were heard of, the oldest first.
        self._static: OrderedDict[str, None] = OrderedDict()
        self._moving: OrderedDict[str, None] = OrderedDict()
        self._forgotten = 0
        self._conflicts: dict[str, str] = {}
        self._jumps: dict[str, str] = {}

    @property
    def problem(self) -> str:
        """What disagrees, or that the last message had too many frames, as a sentence; empty where all is well."""
        crowd = (
            f"expected at most {MAX_LINKS} frames on /tf_static and /tf, got {self._forgotten} more: those that were "
            "heard of longest ago are forgotten, none that the node needs; mend who publishes ever new names"
        )
        crowds = (crowd,) if self._forgotten else ()
        return next(iter((*self._conflicts.values(), *self._jumps.values(), *crowds)), "")

    def add(self, links: Sequence[StampedTransform], *, is_static: bool) -> tuple[StampedTransform, ...]:
        """Takes the links of a message.

        Args:
            links: The message's.
            is_static: They are of `/tf_static`.

        Returns:
            Those that were taken.

        Raises:
            GeometryError: for a link that the tree refuses; those before it are taken.
        """
        taken = []
        self._forgotten = 0
        kept = self._transforms.joining(self._needed()) if self._is_crowded(links) else frozenset()
        for link in links:
            child = link.child_frame.lstrip("/")
            if self._accepts_static(child, link) if is_static else self._accepts_moving(child, link):
                if not self._transforms.has_room_for(child):
                    self._forget_oldest(kept)
                self._transforms.set(link.parent_frame, link.child_frame, link.parent_from_child)
                taken.append(link)
                self._note(child, is_static=is_static)
                if not is_static:
                    self._mounts.add(link)
        return tuple(taken)

    def _is_crowded(self, links: Sequence[StampedTransform]) -> bool:
        """Whether the tree might be full before these are in it."""
        return len(self._static) + len(self._moving) + len(links) > MAX_LINKS

    def _note(self, child: str, *, is_static: bool) -> None:
        heard = self._static if is_static else self._moving
        heard[child] = None
        heard.move_to_end(child)
        if is_static:
            self._moving.pop(child, None)

    def _forget_oldest(self, kept: frozenset[str]) -> None:
        for heard in (self._moving, self._static):
            child = next((child for child in heard if child not in kept), None)
            if child is not None:
                for entries in (heard, self._conflicts, self._jumps):
                    entries.pop(child, None)
                self._transforms.remove(child)
                self._mounts.forget(child)
                self._forgotten += 1
                return

    def _accepts_moving(self, child: str, link: StampedTransform) -> bool:
        if child not in self._static:
            return True
        difference = self._difference(child, link)
        if difference:
            self._conflicts[child] = (
                f"expected {child!r} to be placed by one of /tf_static and /tf, got both, {difference}: what /tf says "
                "of it is left out; stop one of the two publishers"
            )
        else:
            self._conflicts.pop(child, None)
        return False

    def _accepts_static(self, child: str, link: StampedTransform) -> bool:
        difference = self._difference(child, link) if child in self._static else ""
        if not difference:
            return True
        what = "its first value is kept" if self._refuses_jumps else "it is followed"
        self._jumps[child] = (
            f"expected the transform of {child!r} on /tf_static to stay, got another one, {difference}: {what}; mend "
            "who publishes it, or publish what moves on /tf"
        )
        return not self._refuses_jumps

    def _difference(self, child: str, link: StampedTransform) -> str:
        """How a link differs from what the tree has, in words; empty where it does not."""
        known = self._transforms.link(child)
        if known is None:
            return ""
        parent, pose = known
        if parent != link.parent_frame.lstrip("/"):
            return f"below {parent!r} and below {link.parent_frame!r}"
        moved_m, turned_deg = _apart(pose, link.parent_from_child)
        if moved_m <= JUMP_M and turned_deg <= JUMP_DEG:
            return ""
        return f"{moved_m:.2f} m and {turned_deg:.1f} degrees apart"


def _apart(first: RigidTransform, second: RigidTransform) -> tuple[float, float]:
    """Distance in metres and angle in degrees between two poses."""
    change = first.inverse() @ second
    cosine = (float(np.trace(change.rotation)) - 1.0) / 2.0
    return float(np.linalg.norm(change.translation)), math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
