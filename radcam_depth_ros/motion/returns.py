"""Moves radar returns to an image's time, by the vehicle's motion and their Doppler."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.frame import RadarReturns
from radcam_depth_ros.geometry import DoubleArray, RigidTransform
from radcam_depth_ros.motion.vehicle import Motion, MotionError

MOVING_MPS = 1.0
"""A return that is faster over ground moves; one that is slower may be an error of azimuth, Doppler or odometry."""
_FASTEST_MPS = 100.0
"""No vehicle is faster: that is a fault of a sensor, or a place that was set anew."""
_JITTER_M = 1.0
_SPEED_WINDOW_NS = 50_000_000
"""The vehicle's speed is that over so long before and after."""
_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Displacement:
    """How a radar moved between a sweep and an image.

    Attributes:
        image_from_sweep: From the camera's axes at the sweep's time to those at the image's.
        radar_m: (3,) the radar's place in the camera's axes, metres.
        velocity_mps: (3,) the radar's velocity over ground at the sweep's time, in the camera's axes; None where
            unknown.
        age_s: Seconds from the sweep to the image.
    """

    image_from_sweep: RigidTransform
    radar_m: DoubleArray
    velocity_mps: DoubleArray | None
    age_s: float


def displacement(
    motion: Motion, base_from_camera: RigidTransform, radar_m: DoubleArray, sweep_ns: int, image_ns: int
) -> Displacement:
    """How a radar moved between a sweep and an image.

    Args:
        motion: The vehicle's.
        base_from_camera: From the camera to `motion.base_frame`.
        radar_m: (3,) the radar's place in the camera's axes, metres.
        sweep_ns: The sweep's time.
        image_ns: The image's time, on the same clock as the sweep's and the poses'.

    Raises:
        MotionError: where nobody knows.
    """
    at_image, at_sweep = (_known(motion, when_ns) for when_ns in (image_ns, sweep_ns))
    world_from_camera = at_sweep @ base_from_camera
    image_from_sweep = (at_image @ base_from_camera).inverse() @ world_from_camera
    age_s = (image_ns - sweep_ns) / _SECOND
    if not np.linalg.norm(image_from_sweep.translation) <= _FASTEST_MPS * abs(age_s) + _JITTER_M:
        raise MotionError(f"{motion.topic} has the vehicle jump to another place")
    radar_from_base = base_from_camera.rotation @ radar_m + base_from_camera.translation
    velocity = _velocity(motion, radar_from_base, sweep_ns)
    if velocity is not None:
        velocity = world_from_camera.rotation.T @ velocity
    return Displacement(image_from_sweep, radar_m, velocity, age_s)


def _known(motion: Motion, time_ns: int) -> RigidTransform:
    pose = motion.at(time_ns)
    if pose is None:
        raise MotionError(motion.why_unknown(time_ns))
    return pose


def _velocity(motion: Motion, point_m: DoubleArray, time_ns: int) -> DoubleArray | None:
    """(3,) m/s over ground of a point that is fixed to the vehicle, in the axes of the world."""
    places = [
        (when_ns, pose.rotation @ point_m + pose.translation)
        for when_ns in (time_ns - _SPEED_WINDOW_NS, time_ns, time_ns + _SPEED_WINDOW_NS)
        if (pose := motion.at(when_ns)) is not None
    ]
    if len(places) < 2:
        return None
    (start_ns, start_m), (end_ns, end_m) = places[0], places[-1]
    velocity: DoubleArray = (end_m - start_m) * (_SECOND / (end_ns - start_ns))
    return velocity if np.linalg.norm(velocity) <= _FASTEST_MPS else None


def move(returns: RadarReturns, how: Displacement, *, is_over_ground: bool = False) -> RadarReturns:
    """The returns of a sweep where they are at the image's time.

    What stands still does so in the world. What moves over ground, as far as Doppler tells, also moves along its line
    of sight; across it nobody knows. Ages stay those of the detections.

    Args:
        returns: In the camera's axes at the sweep's time.
        how: How the radar moved since.
        is_over_ground: Radial speeds are free of the vehicle's own motion already.
    """
    sight = returns.xyz_m - how.radar_m
    distance = np.linalg.norm(sight, axis=1, keepdims=True)
    sight = np.divide(sight, distance, out=np.zeros_like(sight), where=distance > 0)
    speed = returns.radial_speed_mps.astype(np.float64)
    if not is_over_ground:
        speed = speed + sight @ how.velocity_mps if how.velocity_mps is not None else np.zeros(len(returns))
    with np.errstate(invalid="ignore"):
        is_moving = (np.abs(speed) > MOVING_MPS) & (np.abs(speed) <= _FASTEST_MPS)
    along_m = np.where(is_moving, speed, 0.0) * how.age_s
    xyz_m = how.image_from_sweep.apply(returns.xyz_m + along_m[:, None] * sight)
    return RadarReturns(xyz_m, returns.rcs_dbsm, returns.radial_speed_mps, returns.age_s)
