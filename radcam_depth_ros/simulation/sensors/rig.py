"""Draws the mounting of the sensors on the vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.settings.configuration import CameraConfig
from radcam_depth_ros.simulation.settings.randomness import Stream, generator
from radcam_depth_ros.simulation.settings.sensor_configuration import ImagingRadarConfig, LidarConfig, RadarConfig

FOOTPRINT, BASE = "base_footprint", "base_link"
CAMERA, RADAR, IMAGING_RADAR, LIDAR = "camera_optical", "radar", "radar_4d", "lidar"
ODOMETRY = "odom"

_BASE_HEIGHT_M = 0.35
_BUMPER_M, _ROOF_M = 2.35, 0.9
# A radar that sits higher than a bumper sits on the roof.
_HIGHEST_BUMPER_M = 0.9
_PEAK = 4.0
"""Exponent of the distribution of camera heights around the usual one."""


@dataclass(frozen=True)
class Rig:
    """The sensors of a seed.

    Attributes:
        camera: The camera's intrinsics.
        footprint_from_base: Place of `base_link` above the footprint, which is on the road.
        base_from_sensor: Mounting of each sensor's frame on `base_link`, by frame name, as its transform tells.
    """

    camera: CameraModel
    footprint_from_base: RigidTransform
    base_from_sensor: dict[str, RigidTransform]

    def footprint_from(self, frame: str) -> RigidTransform:
        """Pose of a sensor in the footprint frame."""
        return self.footprint_from_base @ self.base_from_sensor[frame]


def draw_rig(
    seed: int, config: CameraConfig, radar: RadarConfig, imaging_radar: ImagingRadarConfig, lidar: LidarConfig
) -> Rig:
    """Draws the mounting and the lens of a seed."""
    rng = generator(seed, Stream.RIG)
    # Drawn as shares first, so that another image size or range of focal lengths leaves the mounting as it is.
    focal, height, pitch, roll, yaw, shift_x, shift_y = rng.uniform(-1, 1, 7)
    low, high = np.log(config.min_focal_length_px), np.log(config.max_focal_length_px)
    focal_px = float(np.exp(low + (high - low) * (focal + 1) / 2))
    # Exactly, whatever a processor makes of exp(log(x)).
    focal_px = min(max(focal_px, config.min_focal_length_px), config.max_focal_length_px)
    # A generator of its own, so that a range of sizes leaves the mounting as it is, too.
    sizes = generator(seed, Stream.RIG, 1)
    width = int(sizes.integers(config.min_width or config.width, config.width + 1))
    height_px = int(sizes.integers(config.min_height or config.height, config.height + 1))
    camera = CameraModel(
        width,
        height_px,
        focal_px,
        focal_px,
        (width - 1) / 2 + 0.02 * width * float(shift_x),
        (height_px - 1) / 2 + 0.02 * height_px * float(shift_y),
    )
    height_m = _camera_height_m(config, (float(height) + 1) / 2)
    tilt = np.deg2rad([roll * config.max_pitch_deg / 3, pitch * config.max_pitch_deg, yaw * config.max_pitch_deg / 2])
    optical = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))
    radar_yaw, imaging_yaw, lidar_yaw = rng.normal(0, np.deg2rad(0.5), 3)
    aside = rng.uniform(-0.3, 0.3, 3)
    return Rig(
        camera,
        RigidTransform(np.eye(3), np.array([0.0, 0.0, _BASE_HEIGHT_M])),
        {
            CAMERA: _mounted(rng.uniform(0.6, 1.2), float(aside[0]) * 0.5, height_m, *tilt) @ optical,
            RADAR: _radar_mounted(radar, rng.random(), float(aside[1]), float(radar_yaw)),
            IMAGING_RADAR: _radar_mounted(imaging_radar, rng.random(), float(aside[2]), float(imaging_yaw)),
            LIDAR: _mounted(0.2, 0.0, rng.uniform(lidar.min_height_m, lidar.max_height_m), 0.0, 0.0, float(lidar_yaw)),
        },
    )


def _camera_height_m(config: CameraConfig, share: float) -> float:
    """The height below which `share` (0 to 1) of all cameras are.

    With a usual height it is the two-sided power distribution of exponent `_PEAK`: from 1 to 3 m around 1.4 m, half of
    all cameras are below 1.58 m, 90 % below 2.05 m and 99 % below 2.47 m.
    """
    low, usual, high = config.min_height_m, config.usual_height_m, config.max_height_m
    if usual == 0:
        return low + (high - low) * share
    below = (usual - low) / (high - low) if high > low else 1.0
    if share < below:
        return low + (usual - low) * math.pow(share / below, 1 / _PEAK)
    return high - (high - usual) * math.pow((1 - share) / max(1 - below, 1e-9), 1 / _PEAK)


def _radar_mounted(config: RadarConfig, share: float, y: float, yaw: float) -> RigidTransform:
    height_m = config.min_height_m + (config.max_height_m - config.min_height_m) * share
    return _mounted(_BUMPER_M if height_m < _HIGHEST_BUMPER_M else _ROOF_M, y, height_m, 0.0, 0.0, yaw)


def _mounted(x: float, y: float, height_m: float, roll: float, pitch: float, yaw: float) -> RigidTransform:
    """A sensor at a height above the road, turned by angles in radians; a positive pitch looks down."""
    half = np.array([roll, pitch, yaw]) / 2
    (sr, sp, sy), (cr, cp, cy) = np.sin(half), np.cos(half)
    quaternion = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    return RigidTransform.from_quaternion((x, y, height_m - _BASE_HEIGHT_M), quaternion)
