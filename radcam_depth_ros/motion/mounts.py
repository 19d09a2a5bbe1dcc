"""Poses of sensors on a vehicle at a time, moving mounts included: a camera that pans, a sprung cab."""

from __future__ import annotations

from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform
from radcam_depth_ros.motion.links import Memory, MovingLinks


class Mounts:
    """A transform tree whose moving links are taken at the time that is asked for.

    A link is interpolated between the poses around that time. Where these are not known, it is where it was told to be
    at the nearest time: who publishes only what changes is believed.

    Args:
        transforms: The tree, which has the newest pose of each link.
        memory: How much of the moving links is kept.
    """

    def __init__(self, transforms: TransformTree, memory: Memory) -> None:
        self._transforms = transforms
        self._moving = MovingLinks(memory)

    def add(self, link: StampedTransform) -> None:
        """Takes a link of `/tf`, which the tree has already."""
        parent, child = link.parent_frame.lstrip("/"), link.child_frame.lstrip("/")
        self._moving.add(parent, child, link.stamp_ns, link.parent_from_child)

    def forget(self, child_frame: str) -> None:
        """Forgets a link, which the tree has no more."""
        self._moving.forget(child_frame.lstrip("/"))

    def lookup(self, target_frame: str, target_ns: int, source_frame: str, source_ns: int) -> RigidTransform:
        """`target_from_source`, each frame where it was at its time on what carries both of them.

        Args:
            target_frame: Frame to which points are taken, such as the camera's.
            target_ns: When it is there: the image's time.
            source_frame: Frame of the points, such as the radar's.
            source_ns: When it was there: the sweep's time.

        Raises:
            GeometryError: when a frame is not known, or the two are in trees that are not joined.
        """
        latest = self._transforms.lookup(target_frame, source_frame)
        if not self._moving:
            return latest
        above_target, above_source = self._path(target_frame), self._path(source_frame)
        shared = next(frame for frame in above_source if frame in above_target)
        to_target = above_target[: above_target.index(shared)]
        to_source = above_source[: above_source.index(shared)]
        if not any(self._is_moving(frame) for frame in (*to_target, *to_source)):
            return latest
        return self._placed(to_target, target_ns).inverse() @ self._placed(to_source, source_ns)

    def forget_before(self, time_ns: int) -> None:
        """Forgets poses that no time from this one on needs."""
        self._moving.forget_before(time_ns)

    def _path(self, frame: str) -> tuple[str, ...]:
        """The frame and all above it, up to its tree's root."""
        path = [frame.lstrip("/")]
        while (parent := self._transforms.parent_of(path[-1])) is not None:
            path.append(parent)
        return tuple(path)

    def _is_moving(self, frame: str) -> bool:
        parent = self._transforms.parent_of(frame)
        return parent is not None and self._moving.has(parent, frame)

    def _placed(self, frames: tuple[str, ...], time_ns: int) -> RigidTransform:
        """From the first of a chain of frames to the parent of its last, at a time."""
        placed = RigidTransform.identity()
        for frame in frames:
            link = self._transforms.link(frame)
            pose = link[1] if link is not None else RigidTransform.identity()
            if self._is_moving(frame):
                pose = self._moving.at(frame, time_ns) or self._moving.nearest(frame, time_ns) or pose
            placed = pose @ placed
        return placed
