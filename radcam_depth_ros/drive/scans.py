"""Holds the LiDAR scans of some seconds before and after an image, each with its pose in the world."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import cached_property

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.bags.reader import BagMessage
from radcam_depth_ros.drive.range_view import RangeView, Tolerance, Verdict
from radcam_depth_ros.drive.settings import AccumulationConfig
from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import PointsReading, decode_points
from radcam_depth_ros.motion import Motion

_SECOND = 1_000_000_000
_JUMP_NS = _SECOND
_PATIENCE_NS = 2 * _SECOND
"""Scans and poses are recorded no later than this after one another, if they were taken at one time."""
_WITNESSES_S = tuple(sign * 0.25 * 2**power for power in range(6) for sign in (-1, 1))
"""When the scans were taken, relative to a scan, that say what moved in it: soon after for what is fast, long after for
what is slow."""
_LATE_NS = round(1.5 * _SECOND)
"""In this time a lorry has driven its own length."""
_MAX_WAITING = 64


class Scan:
    """A scan with its place.

    Args:
        stamp_ns: When it was taken.
        world_from_scan: Its place; the scan's axes are the vehicle's, around the sensor.
        points_m: (N, 3) float32 metres in these axes.
    """

    def __init__(self, stamp_ns: int, world_from_scan: RigidTransform, points_m: FloatArray) -> None:
        self.stamp_ns = stamp_ns
        self.world_from_scan = world_from_scan
        self.points_m = points_m
        self._standing_m: FloatArray | None = None

    @cached_property
    def view(self) -> RangeView:
        """What it saw in each direction; made when it is first asked for, since a scan alone never is."""
        return RangeView(self.points_m)

    def standing_m(self, others: tuple[Scan, ...], tolerance: Tolerance) -> FloatArray:
        """The points of what does not move: most of the scans before and after that can tell see them as well."""
        if self._standing_m is None:
            self._standing_m = self.points_m[~self._has_moved(others, tolerance)]
        return self._standing_m

    def _has_moved(self, others: tuple[Scan, ...], tolerance: Tolerance) -> npt.NDArray[np.bool_]:
        witnesses = _witnesses(self.stamp_ns, others)
        seen, through = (np.zeros(len(self.points_m), np.int8) for _ in range(2))
        for other in witnesses:
            there = other.world_from_scan.inverse() @ self.world_from_scan
            verdict = other.view.check(there.apply(self.points_m), tolerance)
            seen += verdict == Verdict.AGREES
            through += (verdict == Verdict.SEEN_THROUGH) | (verdict == Verdict.OPEN)
        return (through >= seen) & (through > 0)


class ScanWindow:
    """Reads ahead of the images, and keeps no more scans than one image needs.

    Args:
        messages: The bag's, of the LiDAR and of the vehicle's motion, in their order.
        lidar: The LiDAR's topic.
        motion: Filled from the messages.
        transforms: The vehicle's fixed frames.
        config: How far the window reaches.
    """

    def __init__(
        self,
        messages: Iterator[BagMessage],
        lidar: str,
        motion: Motion,
        transforms: TransformTree,
        config: AccumulationConfig,
    ) -> None:
        self._messages, self._lidar, self._motion = messages, lidar, motion
        self._transforms, self._config = transforms, config
        self._window_ns = round(config.window_s * _SECOND)
        self._asked_ns: int | None = None
        self._newest_ns: int | None = None  # of the scans
        self._held: BagMessage | None = None
        self._waiting: deque[PointsReading] = deque(maxlen=_MAX_WAITING)  # for the pose of their time
        self._scans: deque[Scan] = deque()

    def around(self, stamp_ns: int) -> tuple[Scan, ...]:
        """The scans that the window of a time holds, in their order.

        Args:
            stamp_ns: The time; later than those before, but where the bag's stamps jump back (a looped bag).

        Raises:
            GeometryError: when nobody tells where the LiDAR is on the vehicle.
        """
        if self._asked_ns is not None and stamp_ns < self._asked_ns - _JUMP_NS:
            self._start_anew()
        self._asked_ns = stamp_ns
        while not self._is_filled(stamp_ns):
            if not self._read():
                break
        self._forget(stamp_ns)
        return tuple(self._scans)

    def _is_filled(self, stamp_ns: int) -> bool:
        until_ns = stamp_ns + self._window_ns
        after = sum(scan.stamp_ns > stamp_ns for scan in self._scans)
        return (
            after >= self._config.scans
            or (after > 0 and self._scans[-1].stamp_ns > until_ns)
            or (self._newest_ns is not None and self._newest_ns > until_ns + _PATIENCE_NS)
            or self._motion.covers(until_ns + _PATIENCE_NS)
        )

    def _read(self) -> bool:
        """Takes a message; False at the bag's end, and where scans from before a backward jump are all there."""
        message = self._held or next(self._messages, None)
        self._held = None
        if message is None:
            return False
        if message.topic == self._motion.topic:
            self._motion.add(message.message)
        else:
            scan = decode_points(message.message)
            if self._newest_ns is not None and scan.stamp_ns < self._newest_ns - _JUMP_NS:
                self._held = message
                return False
            self._newest_ns = max(scan.stamp_ns, self._newest_ns or scan.stamp_ns)
            self._waiting.append(scan)
        self._place()
        return True

    def _place(self) -> None:
        while self._waiting and self._motion.covers(self._waiting[0].stamp_ns):
            scan = self._waiting.popleft()
            pose = self._motion.at(scan.stamp_ns)
            base_frame = self._motion.base_frame
            if (
                pose is None
                or base_frame is None
                or not self._transforms.can_transform(base_frame, self._motion.anchor)
            ):
                continue
            base_from_lidar = self._transforms.lookup(base_frame, scan.frame_id)
            # Turned into the vehicle's axes: z is up, however the sensor is mounted.
            turned = RigidTransform(base_from_lidar.rotation, np.zeros(3))
            place = RigidTransform(np.eye(3), base_from_lidar.translation)
            self._scans.append(Scan(scan.stamp_ns, pose @ place, turned.apply(scan.xyz_m)))
            if self._asked_ns is not None:
                self._forget(self._asked_ns)

    def _forget(self, stamp_ns: int) -> None:
        before = sum(scan.stamp_ns <= stamp_ns for scan in self._scans)
        while self._scans and (before > self._config.scans or self._scans[0].stamp_ns < stamp_ns - self._window_ns):
            self._scans.popleft()
            before -= 1
        self._motion.forget_before(stamp_ns - self._window_ns)

    def _start_anew(self) -> None:
        self._scans.clear()
        self._waiting.clear()
        self._motion.clear()
        self._newest_ns = None


def _witnesses(stamp_ns: int, scans: tuple[Scan, ...]) -> list[Scan]:
    """The scans nearest to each of the times that are to be asked, each once, never the scan itself."""
    found: dict[int, Scan] = {}
    for offset_s in _WITNESSES_S:
        wanted_ns = stamp_ns + round(offset_s * _SECOND)
        scan = min(scans, key=lambda scan: abs(scan.stamp_ns - wanted_ns))
        if abs(scan.stamp_ns - wanted_ns) <= abs(offset_s) / 4 * _SECOND:
            found[scan.stamp_ns] = scan
    found.pop(stamp_ns, None)
    return list(found.values())
