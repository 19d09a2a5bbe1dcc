"""Sweeps of two radars: one like the ARS408 without elevation, and an imaging (4D) radar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.sensors.detections import (
    Cells,
    detected,
    gather,
    level_db,
    with_false_echoes,
    with_spread,
)
from radcam_depth_ros.simulation.sensors.echoes import Echoes, Fan, trace
from radcam_depth_ros.simulation.sensors.radar_unit import ImagingRadarUnit, RadarUnit

_MOVING_MPS = 0.6
# The ARS408's data sheet: two scans in turns, the far one narrow and coarse in range.
_FAR_HALF_VIEW = np.deg2rad(9.0)
_FAR = Cells(range_m=1.79, azimuth=np.deg2rad(1.6), elevation=10.0, speed_mps=0.4)
_NEAR = Cells(range_m=0.39, azimuth=np.deg2rad(3.2), elevation=10.0, speed_mps=0.4)
# What the radar reports of the quality of every return, by the column's name in nuScenes' files.
_CONSTANT = {
    **{"is_quality_valid": 1, "ambig_state": 3, "x_rms": 19, "y_rms": 19},
    **{"invalid_state": 0, "pdh0": 1, "vx_rms": 16, "vy_rms": 3},
}
_NEAR_REACH_M, _NEAR_REACH_ASIDE_M, _ASIDE = 70.0, 20.0, np.deg2rad(60.0)


def sweep_radar(
    scene: Scene,
    world_from_radar: RigidTransform,
    radar_velocity: npt.NDArray[np.floating],
    unit: RadarUnit,
    rng: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """One sweep of the radar without elevation, as the columns of nuScenes' radar files.

    All points lie in the radar's own plane, z = 0: nothing is known of their height.
    """
    columns = int(np.rad2deg(unit.half_view) * 4) + 1
    fan = Fan.around_horizon(unit.half_view, columns, np.deg2rad(-7.0), np.deg2rad(9.0), 21)
    echoes = trace(scene, world_from_radar, radar_velocity, fan, unit, rng)
    found = detected(_two_scans(echoes), unit, rng)
    found = with_false_echoes(found, unit, rng)
    count = len(found)
    # The beam widens to the sides, and so does the error of the angle.
    wider = 1 + 4 * (found.azimuth / _ASIDE) ** 4
    azimuth = found.azimuth + unit.azimuth_noise * wider * _steadiness(found, unit) * rng.standard_normal(count)
    range_m = np.maximum(found.range_m + unit.range_noise_m * rng.standard_normal(count), 0.2)
    error = unit.config.speed_noise_mps * rng.standard_normal(count)
    speed, ground_speed = found.speed_mps + error, found.ground_speed_mps + error
    section = 10 * np.log10(np.maximum(found.section_m2, 1e-6)) + rng.normal(0, 1.0, count)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    moving = np.where(ground_speed > _MOVING_MPS, 0, np.where(ground_speed < -_MOVING_MPS, 2, 1))
    return {
        "x": (range_m * cos).astype(np.float32),
        "y": (range_m * sin).astype(np.float32),
        "z": np.zeros(count, np.float32),
        "dyn_prop": moving.astype(np.int8),
        "id": np.arange(count, dtype=np.int16),
        # The ARS408 gives its cross sections in steps of half a dB.
        "rcs": (np.round(np.clip(section, -64, 63) * 2) / 2).astype(np.float32),
        "vx": (speed * cos).astype(np.float32),
        "vy": (speed * sin).astype(np.float32),
        "vx_comp": (ground_speed * cos).astype(np.float32),
        "vy_comp": (ground_speed * sin).astype(np.float32),
        **{name: np.full(count, value, np.int8) for name, value in _CONSTANT.items()},
    }


def sweep_imaging_radar(
    scene: Scene,
    world_from_radar: RigidTransform,
    radar_velocity: npt.NDArray[np.floating],
    unit: ImagingRadarUnit,
    rng: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """One sweep of the 4D radar: x y z, radial speed against the sensor, cross section or level in dB."""
    # A radar of more points needs more rays to have them from.
    rays_per_degree = float(np.clip(0.7 + unit.max_points / 2500, 1.0, 2.5))
    columns = int(np.rad2deg(2 * unit.half_view) * rays_per_degree) + 1
    fan = Fan.around_horizon(unit.half_view, columns, np.deg2rad(-14.0), np.deg2rad(16.0), 30)
    echoes = trace(scene, world_from_radar, radar_velocity, fan, unit, rng)
    # Its threshold follows what it sees, so that no sweep has as many points as another.
    unit = replace(unit, max_points=max(1, round(unit.max_points * rng.lognormal(-0.1, 0.25))))
    found = detected(gather(echoes, Cells(unit.range_cell_m, unit.azimuth_cell, np.deg2rad(1.5), 0.4)), unit, rng)
    found = with_false_echoes(with_spread(found, unit, unit.spread, rng), unit, rng)
    count, steady = len(found), _steadiness(found, unit)
    range_m = np.maximum(found.range_m + unit.range_noise_m * rng.standard_normal(count), 0.2)
    azimuth = found.azimuth + unit.azimuth_noise * steady * rng.standard_normal(count)
    # Elevations come from few antennas: their errors have long tails, up to the edges of what the beam sees.
    error = unit.elevation_noise * steady * rng.standard_t(4, count)
    elevation = np.clip(found.elevation + error, np.deg2rad(-20.0), np.deg2rad(20.0))
    speed = found.speed_mps + unit.config.speed_noise_mps * rng.standard_normal(count)
    half = unit.speed_span_mps / 2
    intensity = 10 * np.log10(np.maximum(found.section_m2, 1e-6)) + rng.normal(0, 1.0, count)
    if unit.intensity_is_level:
        intensity = np.maximum(level_db(found, unit) + rng.normal(0, 1.0, count), 0)
    return {
        "x": (range_m * np.cos(elevation) * np.cos(azimuth)).astype(np.float32),
        "y": (range_m * np.cos(elevation) * np.sin(azimuth)).astype(np.float32),
        "z": (range_m * np.sin(elevation)).astype(np.float32),
        "velocity": ((speed + half) % unit.speed_span_mps - half).astype(np.float32),
        "intensity": (np.round((intensity + unit.intensity_offset_db) * 2) / 2).astype(np.float32),
    }


def _two_scans(echoes: Echoes) -> Echoes:
    """What both scans see, each in its own cells; things before the vehicle are in both."""
    across = np.abs(echoes.azimuth)
    reach_m = _NEAR_REACH_M + (_NEAR_REACH_ASIDE_M - _NEAR_REACH_M) * np.clip(3 * across / _ASIDE - 2, 0, 1)
    far = echoes.some(across < _FAR_HALF_VIEW)
    return gather(far, _FAR).joined(gather(echoes.some(echoes.range_m < reach_m), _NEAR))


def _steadiness(echoes: Echoes, unit: RadarUnit) -> FloatArray:
    """How much smaller the error of an angle is than that of a return that is just seen, (N,) 0.4 to 1."""
    return np.asarray(0.4 + 0.6 * 10 ** (-np.maximum(level_db(echoes, unit), 0) / 15), np.float32)
