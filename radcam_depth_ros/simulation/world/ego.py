"""The own vehicle: how it drives along its lane, and its pose and velocity at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.settings.style import StreetStyle
from radcam_depth_ros.simulation.world.path import DoubleArray, Path
from radcam_depth_ros.simulation.world.relief import Relief

_DERIVATIVE_S = 1e-3


@dataclass(frozen=True)
class EgoMotion:
    """The state of the vehicle's footprint frame at one time.

    Attributes:
        world_from_base: Pose; x forward, y left, z up, on the road.
        velocity: (3,) m/s in world axes.
        rotation_rate: (3,) rad/s in world axes.
    """

    world_from_base: RigidTransform
    velocity: DoubleArray
    rotation_rate: DoubleArray

    def velocity_at(self, point: npt.NDArray[np.floating]) -> DoubleArray:
        """Velocity (3,), m/s in world axes, of a point (3,) that is fixed to the vehicle and given in its frame."""
        arm = self.world_from_base.rotation @ np.asarray(point, np.float64)
        return np.asarray(self.velocity + np.cross(self.rotation_rate, arm), np.float64)


class EgoDrive:
    """The own vehicle's drive: speed that swells and falls, a little wandering in the lane, a little pitch and roll."""

    def __init__(self, rng: np.random.Generator, style: StreetStyle, path: Path, relief: Relief) -> None:
        self._path, self._relief = path, relief
        self._speed, self._askew = style.speed_mps, style.askew_rad
        self._swell = float(rng.uniform(0.0, 0.7))
        self._period = float(rng.uniform(18, 60))
        self._phase = float(rng.uniform(0, 2 * np.pi))
        self.lane = int(rng.integers(style.open_lanes))
        self._offset = style.lane_centre_m(self.lane) + float(rng.normal(0, 0.2))
        self._wander = rng.uniform([0.02, 0.02, 0.0, 0.0], [0.3, 0.12, 0.004, 0.004])
        self._waves = rng.uniform([9, 4, 0.9, 1.3], [20, 8, 2.0, 2.6])
        self._phases = rng.uniform(0, 2 * np.pi, 4)

    def s(self, time: npt.ArrayLike) -> DoubleArray:
        """Metres along the road at times in seconds; 0 at time 0."""
        seconds = np.asarray(time, np.float64)
        rate = 2 * np.pi / self._period
        swell = np.cos(self._phase) - np.cos(rate * seconds + self._phase)
        return np.asarray(self._speed * (seconds + self._swell / rate * swell), np.float64)

    def world_from_base(self, time: float) -> RigidTransform:
        """Pose of the footprint frame at a time, seconds."""
        waves = self._wander * np.sin(2 * np.pi * time / self._waves + self._phases)
        lateral, speed_share = waves[0] + waves[1], min(1.0, self._speed / 5.0)
        s = float(self.s(time))
        t = self._offset + lateral * speed_share
        x, y = self._path.position(s, t)
        slopes = (
            self._wander[:2]
            * 2
            * np.pi
            / self._waves[:2]
            * np.cos(2 * np.pi * time / self._waves[:2] + self._phases[:2])
        )
        yaw = float(self._path.heading(s)) + float(slopes.sum()) * speed_share / max(self._speed, 5.0) + self._askew
        uphill = self._relief.slope(float(x), float(y))
        ahead, left = uphill @ [np.cos(yaw), np.sin(yaw)], uphill @ [-np.sin(yaw), np.cos(yaw)]
        along = float(np.diff(self._path.camber([s - 0.5, s + 0.5], t))[0])
        across = float(np.diff(self._path.camber(s, [t - 0.5, t + 0.5]))[0])
        cosine, sine = np.cos(self._askew), np.sin(self._askew)
        ahead, left = ahead + along * cosine + across * sine, left - along * sine + across * cosine
        pitch = float(waves[2]) * speed_share - float(np.arctan(ahead))
        roll = float(waves[3]) * speed_share + float(np.arctan(left))
        place = np.array([float(x), float(y), float(self._relief.height(float(x), float(y)) + self._path.camber(s, t))])
        return RigidTransform(_rotation(yaw, pitch, roll), place)

    def motion(self, time: float) -> EgoMotion:
        """Pose and velocities at a time, seconds."""
        before, now, after = (self.world_from_base(time + step) for step in (-_DERIVATIVE_S, 0.0, _DERIVATIVE_S))
        velocity = (after.translation - before.translation) / (2 * _DERIVATIVE_S)
        turn = (after.rotation @ before.rotation.T) / (2 * _DERIVATIVE_S)
        rate = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        return EgoMotion(now, velocity, rate)


def _rotation(yaw: float, pitch: float, roll: float) -> DoubleArray:
    cy, sy, cp, sp, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    about_y = np.array([[cp, 0, sp], [0, 1.0, 0], [-sp, 0, cp]])
    about_x = np.array([[1.0, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(about_z @ about_y @ about_x, np.float64)
