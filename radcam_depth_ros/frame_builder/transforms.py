"""Takes transforms of `/tf_static` and `/tf`, and notes where they disagree."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform
from radcam_depth_ros.motion import Mounts

JUMP_M, JUMP_DEG = 0.1, 1.0
"""From here on a static transform that comes again is another one; drivers round."""


class TransformIntake:
    """Fills a transform tree.

    A frame that `/tf_static` places is placed by it alone: what `/tf` says of it is left out. A static transform may
    come again, and jump: it is followed, or refused.

    Args:
        transforms: The tree.
        mounts: Told of the links of `/tf` that are taken.
        refuses_jumps: Static transforms keep their first value for good.
    """

    def __init__(self, transforms: TransformTree, mounts: Mounts, *, refuses_jumps: bool) -> None:
        self._transforms = transforms
        self._mounts = mounts
        self._refuses_jumps = refuses_jumps
        self._static: set[str] = set()
        self._conflicts: dict[str, str] = {}
        self._jumps: dict[str, str] = {}

    @property
    def problem(self) -> str:
        """What disagrees, as a sentence; empty where nothing does."""
        return next(iter((*self._conflicts.values(), *self._jumps.values())), "")

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
        for link in links:
            child = link.child_frame.lstrip("/")
            if self._accepts_static(child, link) if is_static else self._accepts_moving(child, link):
                self._transforms.set(link.parent_frame, link.child_frame, link.parent_from_child)
                taken.append(link)
                if is_static:
                    self._static.add(child)
                else:
                    self._mounts.add(link)
        return tuple(taken)

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
