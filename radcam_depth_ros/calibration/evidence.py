"""Scores of a sensor's pose: how well its points fit the image, the road, the LiDAR and the vehicle's motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.calibration.placements import Placement, Pose
from radcam_depth_ros.calibration.recording import Radar, Recording, View
from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane
from radcam_depth_ros.geometry import DoubleArray, RigidTransform, project
from radcam_depth_ros.motion import MotionError, displacement

PARTS = ("view", "road", "lidar", "doppler", "sweeps")
"""Scores of a radar: points in the image, points not below the road, points near the LiDAR's, Doppler that agrees with
the vehicle's motion, and agreement with earlier and later sweeps."""
_SECOND = 1_000_000_000
_LATE_NS = 150_000_000
_MOST_POINTS = 500
_NEAREST_M = 0.3
_MOST_SCAN = 8000
_ON_ROAD_M, _ON_ROAD_SLANT = 0.3, 0.02
_BELOW_M, _ABOVE_M = 1.0, 8.0
_SLANT = 0.035
"""A radar's elevation may be wrong by two degrees, and a road may slope."""
_CELL_M, _CELLS = 0.5, 256
_NEAR_M = 2.0
_REACH_M = 60.0
_UPRIGHT_M = (0.4, 4.0)
_LEAST_SPEED_MPS = 3.0
_AGREES_MPS = 0.5
_SWEEPS_S = (0.4, 2.0)
_MOST_SWEEPS = 6
_LEAST_WAY_M = 3.0
_ELSEWHERE_M = 4.0
_FEWEST = 5


class Floor:
    """Occupied places around the camera, seen from above.

    Args:
        ground: The flat road, known or assumed.
        points_m: (N, 3) metres in the camera's axes.
    """

    def __init__(self, ground: GroundPlane, points_m: npt.NDArray[np.floating]) -> None:
        self._axes = floor_axes(ground)
        column, row, inside = self._cells(points_m)
        free = np.full((_CELLS, _CELLS), 255, np.uint8)
        free[row[inside], column[inside]] = 0
        self._distance_m = cv2.distanceTransform(free, cv2.DIST_L2, 3) * _CELL_M

    def nearness(self, points_m: npt.NDArray[np.floating]) -> float:
        """How near (N, 3) points are to something on average: 1 on it, 0 at 2 m and more; NaN of too few points."""
        column, row, inside = self._cells(points_m)
        if inside.sum() < _FEWEST:
            return float("nan")
        distance_m = self._distance_m[row[inside], column[inside]]
        return float(np.clip(1 - distance_m / _NEAR_M, 0, 1).mean())

    def _cells(
        self, points_m: npt.NDArray[np.floating]
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
        places = np.floor(points_m @ self._axes.T / _CELL_M + _CELLS / 2).astype(np.intp)
        inside: npt.NDArray[np.bool_] = np.all((places >= 0) & (places < _CELLS), axis=1)
        return places[:, 0], places[:, 1], inside


def floor_axes(ground: GroundPlane) -> DoubleArray:
    """(2, 3) unit vectors along the road, in the camera's axes: to the right and ahead."""
    up = np.asarray(ground.up, np.float64)
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(ahead) < 0.1:
        ahead = np.array([0.0, -1.0, 0.0]) + up[1] * up
    ahead = ahead / np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead])


@dataclass(frozen=True)
class _Look:
    """One image with what a radar saw then.

    Attributes:
        points_m: (N, 3) in the radar's frame.
        camera: The camera.
        ground: The road, known or assumed.
        lidar: The LiDAR's upright points.
        others: Points (M, 3) of other sweeps, each with how the camera's axes moved from theirs to the image's time.
        velocity_mps: (3,) the radar's own, in the camera's axes; None where Doppler says nothing.
        sight: (S, 3) directions of the returns that stand still, in the radar's axes.
        speeds_mps: (S,) their radial speeds.
    """

    points_m: FloatArray
    camera: CameraModel
    ground: GroundPlane
    lidar: Floor | None
    others: tuple[tuple[RigidTransform, FloatArray], ...]
    velocity_mps: DoubleArray | None
    sight: DoubleArray
    speeds_mps: DoubleArray


ValueT = TypeVar("ValueT", np.float32, np.intp)

LIDAR_PARTS = ("road", "lidar")
"""Scores of a LiDAR: points on the road, and near the radars' returns."""


def lidar_parts(recording: Recording, placements: Sequence[Placement], radars: Sequence[int]) -> DoubleArray:
    """(placements, images, LIDAR_PARTS) of a LiDAR's place, each 0 to 1; NaN where unknown.

    Args:
        recording: The drive.
        placements: Candidate poses of the LiDAR.
        radars: The radars whose poses are trusted.
    """
    views = [view for view in recording.views if view.lidar_m is not None and len(view.lidar_m) >= _FEWEST]
    found = np.full((len(placements), len(views), len(LIDAR_PARTS)), np.nan)
    for column, view in enumerate(views):
        ground = view.frame.ground.or_assumed()
        parts = [recording.radars[index].camera_from_radar.apply(view.radar_m[index]) for index in radars]
        returns_m = np.concatenate(parts) if parts else np.zeros((0, 3), np.float32)
        returns_m = thinned(returns_m[np.linalg.norm(returns_m, axis=1) < _REACH_M], _MOST_POINTS)
        scan_m = thinned(view.lidar_m, _MOST_SCAN) if view.lidar_m is not None else returns_m
        distance_m = np.linalg.norm(scan_m, axis=1)
        for row, placement in enumerate(placements):
            points_m = placement.pose.apply(scan_m)
            height_m = points_m @ np.asarray(ground.up) + ground.height_m
            on_road = np.abs(height_m) < _ON_ROAD_M + _ON_ROAD_SLANT * distance_m
            nearness = Floor(ground, upright(points_m, ground)).nearness(returns_m)
            found[row, column] = (float(on_road.mean()), nearness)
    return found


class Evidence:
    """Scores of one radar's pose over a drive.

    Args:
        recording: The drive.
        index: The radar's.
    """

    def __init__(self, recording: Recording, index: int) -> None:
        self._recording, self._radar = recording, recording.radars[index]
        self._looks = [look for view in recording.views if (look := self._look(view, index)) is not None]

    def __len__(self) -> int:
        """The number of images with returns."""
        return len(self._looks)

    def parts(self, placements: Sequence[Placement]) -> DoubleArray:
        """(placements, images, PARTS), each 0 to 1; NaN where unknown."""
        found = [[_parts(look, placement.pose) for look in self._looks] for placement in placements]
        return np.asarray(found, np.float64).reshape(len(placements), len(self._looks), len(PARTS))

    def _look(self, view: View, index: int) -> _Look | None:
        radar, frame = self._radar, view.frame
        points_m = thinned(view.radar_m[index], _MOST_POINTS)
        if len(points_m) < _FEWEST:
            return None
        ground = frame.ground.or_assumed()
        lidar = None
        if view.lidar_m is not None and self._recording.camera_from_lidar is not None:
            lidar = Floor(ground, upright(self._recording.camera_from_lidar.apply(view.lidar_m), ground))
        velocity, sight, speeds = self._doppler(radar, frame.stamp_ns)
        others = self._others(radar, frame.stamp_ns)
        return _Look(points_m, frame.camera, ground, lidar, others, velocity, sight, speeds)

    def _doppler(self, radar: Radar, stamp_ns: int) -> tuple[DoubleArray | None, DoubleArray, DoubleArray]:
        """The radar's velocity in the camera's axes, and the directions and speeds of what stands still."""
        nothing = (None, np.zeros((0, 3)), np.zeros(0))
        pairs = zip(radar.sweeps, radar.own_motions, strict=True)
        sweep, own = min(pairs, key=lambda pair: abs(pair[0].stamp_ns - stamp_ns), default=(None, None))
        if sweep is None or own is None or abs(sweep.stamp_ns - stamp_ns) > _LATE_NS:
            return nothing
        velocity = velocity_mps(self._recording, radar, sweep.stamp_ns)
        if velocity is None:
            return nothing
        speed_mps = float(np.linalg.norm(velocity))
        # Another speed than the vehicle's is that of a convoy around it, or of Doppler that is ambiguous.
        if speed_mps < _LEAST_SPEED_MPS or abs(own.speed_mps - speed_mps) > max(1.0, 0.2 * speed_mps):
            return nothing
        distance_m = np.linalg.norm(sweep.xyz_m, axis=1)
        known = np.isfinite(sweep.radial_speed_mps) & (distance_m > 0.5)
        sight = sweep.xyz_m[known] / distance_m[known, None]
        speeds = sweep.radial_speed_mps[known]
        still = np.abs(speeds + sight @ own.velocity_mps) < _AGREES_MPS
        return velocity, sight[still].astype(np.float64), speeds[still].astype(np.float64)

    def _others(self, radar: Radar, stamp_ns: int) -> tuple[tuple[RigidTransform, FloatArray], ...]:
        """Sweeps before and after, with how the camera moved; none where it hardly did."""
        recording = self._recording
        pose, base_from_camera = recording.motion.at(stamp_ns), recording.base_from_camera
        if pose is None or base_from_camera is None:
            return ()
        camera_from_world = (pose @ base_from_camera).inverse()
        low_s, high_s = _SWEEPS_S
        found: list[tuple[RigidTransform, FloatArray]] = []
        for sweep in radar.sweeps:
            if not low_s <= abs(sweep.stamp_ns - stamp_ns) / _SECOND <= high_s:
                continue
            then = recording.motion.at(sweep.stamp_ns)
            if then is None:
                continue
            moved = camera_from_world @ then @ base_from_camera
            if np.linalg.norm(moved.translation) >= _LEAST_WAY_M:
                found.append((moved, thinned(sweep.xyz_m, _MOST_POINTS)))
        if len(found) > _MOST_SWEEPS:
            found = [found[place] for place in np.linspace(0, len(found) - 1, _MOST_SWEEPS).astype(int)]
        return tuple(found)


def velocity_mps(recording: Recording, radar: Radar, stamp_ns: int) -> DoubleArray | None:
    """(3,) a radar's velocity over ground in the camera's axes, m/s; None where nobody knows."""
    if recording.base_from_camera is None:
        return None
    try:
        how = displacement(
            recording.motion, recording.base_from_camera, radar.camera_from_radar.translation_m, stamp_ns, stamp_ns
        )
    except MotionError:
        return None
    return how.velocity_mps


def upright(points_m: FloatArray, ground: GroundPlane) -> FloatArray:
    """The points (N, 3) that are no road and no bridge."""
    height_m = points_m @ np.asarray(ground.up) + ground.height_m
    kept: FloatArray = points_m[(height_m > _UPRIGHT_M[0]) & (height_m < _UPRIGHT_M[1])]
    return kept


def thinned(points: npt.NDArray[ValueT], most: int) -> npt.NDArray[ValueT]:
    """At most so many of some points (or indices) (N, ...), evenly taken."""
    return points if len(points) <= most else points[np.linspace(0, len(points) - 1, most).astype(int)]


def _parts(look: _Look, pose: Pose) -> tuple[float, ...]:
    points_m = pose.apply(look.points_m)
    distance_m = np.linalg.norm(look.points_m, axis=1)
    return (
        float(in_image(points_m, look.camera).mean()),
        _road_share(points_m, distance_m, look.ground),
        look.lidar.nearness(points_m[distance_m < _REACH_M]) if look.lidar is not None else np.nan,
        _doppler_share(look, pose),
        _sweeps_contrast(look, pose, points_m[distance_m < _REACH_M]),
    )


def in_image(points_m: FloatArray, camera: CameraModel) -> npt.NDArray[np.bool_]:
    """(N,) which of some points (N, 3) are in an image."""
    uv, depth_m = project(points_m, camera)
    with np.errstate(invalid="ignore"):
        inside: npt.NDArray[np.bool_] = (uv >= 0).all(axis=1) & (uv[:, 0] < camera.width) & (uv[:, 1] < camera.height)
    return inside & (depth_m > _NEAREST_M)


def _road_share(points_m: FloatArray, distance_m: FloatArray, ground: GroundPlane) -> float:
    height_m = points_m @ np.asarray(ground.up, np.float32) + np.float32(ground.height_m)
    slack_m = _SLANT * distance_m
    return float(((height_m > -_BELOW_M - slack_m) & (height_m < _ABOVE_M + slack_m)).mean())


def _doppler_share(look: _Look, pose: Pose) -> float:
    if look.velocity_mps is None or len(look.speeds_mps) < _FEWEST:
        return float("nan")
    # Slack grows with speed: an azimuth that is a degree off is worth that much more.
    slack_mps = max(_AGREES_MPS, 0.05 * float(np.linalg.norm(look.velocity_mps)))
    expected = -(look.sight @ pose.matrix.T) @ look.velocity_mps
    return float((np.abs(look.speeds_mps - expected) < slack_mps).mean())


def _sweeps_contrast(look: _Look, pose: Pose, points_m: FloatArray) -> float:
    if not look.others:
        return float("nan")
    there = np.concatenate([moved.apply(pose.apply(other)) for moved, other in look.others])
    floor = Floor(look.ground, there)
    # Points in a row, as of a guard rail or of a place that squeezes them, are near to one another wherever they are.
    ahead_m = _ELSEWHERE_M * floor_axes(look.ground)[1]
    by_chance = max(floor.nearness(points_m + sign * ahead_m) for sign in (-1, 1))
    return max(0.0, floor.nearness(points_m) - by_chance)
