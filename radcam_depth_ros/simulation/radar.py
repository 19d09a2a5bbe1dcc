"""Two radars: one like the ARS408 without elevation, and an imaging (4D) radar."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.configuration import ImagingRadarConfig, RadarConfig
from radcam_depth_ros.simulation.echoes import Fan, detected, gather, trace, with_false_echoes
from radcam_depth_ros.simulation.scene import Scene

_MOVING_MPS = 0.6


def sweep_radar(
    scene: Scene,
    world_from_radar: RigidTransform,
    radar_velocity: npt.NDArray[np.floating],
    config: RadarConfig,
    rng: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """One sweep of the radar without elevation, as the columns of nuScenes' radar files.

    All points lie in the radar's own plane, z = 0: nothing is known of their height.
    """
    half = np.deg2rad(config.field_of_view_deg / 2)
    fan = Fan.of_degrees(config.field_of_view_deg / 2, int(config.field_of_view_deg * 2) + 1, -7.0, 9.0, 25)
    echoes = trace(scene, world_from_radar, radar_velocity, fan, config.max_range_m, 0.3, rng)
    cells = gather(echoes, 0.9, np.deg2rad(2.2), 10.0, 1.0)
    found = detected(cells, -6.0, config.missed, config.max_points, rng)
    found = with_false_echoes(
        found, config.ghosts, config.clutter, config.max_range_m, float(half), config.max_points, rng
    )
    count = len(found)
    # The beam widens to the sides, and so does the error of the angle.
    wider = 1 + 2 * (np.abs(found.azimuth) / half) ** 2
    azimuth = found.azimuth + np.deg2rad(config.azimuth_noise_deg) * wider * rng.standard_normal(count)
    range_m = np.maximum(found.range_m + config.range_noise_m * rng.standard_normal(count), 0.2)
    error = config.speed_noise_mps * rng.standard_normal(count)
    speed, ground_speed = found.speed_mps + error, found.ground_speed_mps + error
    section = 10 * np.log10(np.maximum(found.section_m2, 1e-6)) + rng.normal(0, 1.0, count)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    moving = np.where(ground_speed > _MOVING_MPS, 0, np.where(ground_speed < -_MOVING_MPS, 2, 1))
    whole = np.zeros(count, np.int8)
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
        "is_quality_valid": whole + np.int8(1),
        "ambig_state": whole + np.int8(3),
        "x_rms": whole + np.int8(19),
        "y_rms": whole + np.int8(19),
        "invalid_state": whole,
        "pdh0": whole + np.int8(1),
        "vx_rms": whole + np.int8(16),
        "vy_rms": whole + np.int8(3),
    }


def sweep_imaging_radar(
    scene: Scene,
    world_from_radar: RigidTransform,
    radar_velocity: npt.NDArray[np.floating],
    config: ImagingRadarConfig,
    rng: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """One sweep of the 4D radar: x y z, radial speed against the sensor, cross section in dBsm."""
    half = np.deg2rad(config.field_of_view_deg / 2)
    fan = Fan.of_degrees(config.field_of_view_deg / 2, int(config.field_of_view_deg * 2.5) + 1, -10.0, 14.0, 49)
    # It tells most of what comes from below the road from what is there.
    echoes = trace(scene, world_from_radar, radar_velocity, fan, config.max_range_m, 0.02, rng)
    cells = gather(echoes, 0.4, np.deg2rad(1.0), np.deg2rad(1.5), 0.5)
    found = detected(cells, -20.0, config.missed, config.max_points, rng)
    found = with_false_echoes(
        found, config.ghosts, config.clutter, config.max_range_m, float(half), config.max_points, rng
    )
    count = len(found)
    range_m = np.maximum(found.range_m + config.range_noise_m * rng.standard_normal(count), 0.2)
    azimuth = found.azimuth + np.deg2rad(config.azimuth_noise_deg) * rng.standard_normal(count)
    elevation = found.elevation + np.deg2rad(config.elevation_noise_deg) * rng.standard_normal(count)
    return {
        "x": (range_m * np.cos(elevation) * np.cos(azimuth)).astype(np.float32),
        "y": (range_m * np.cos(elevation) * np.sin(azimuth)).astype(np.float32),
        "z": (range_m * np.sin(elevation)).astype(np.float32),
        "velocity": (found.speed_mps + config.speed_noise_mps * rng.standard_normal(count)).astype(np.float32),
        "intensity": (10 * np.log10(np.maximum(found.section_m2, 1e-6)) + rng.normal(0, 1.0, count)).astype(np.float32),
    }
