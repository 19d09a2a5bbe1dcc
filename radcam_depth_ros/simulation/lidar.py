"""A spinning LiDAR."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.configuration import LidarConfig
from radcam_depth_ros.simulation.scene import Scene
from radcam_depth_ros.simulation.surfaces import Surface, surface_table

_LOWEST_DEG, _HIGHEST_DEG = -25.0, 15.0
_WEAKEST = 0.012


def sweep_lidar(
    scene: Scene, world_from_lidar: RigidTransform, config: LidarConfig, rng: np.random.Generator
) -> dict[str, npt.NDArray[np.generic]]:
    """One turn: x y z in metres in the sensor's frame and intensity 0 to 255, all float32.

    Glass sends little back, dark things far away nothing.
    """
    # Beams lie denser around the horizon, as in the sensors that are sold.
    share = np.linspace(-1, 1, config.beams)
    middle, reach = (_LOWEST_DEG + _HIGHEST_DEG) / 2, (_HIGHEST_DEG - _LOWEST_DEG) / 2
    beams = np.deg2rad(middle + reach * (0.45 * share + 0.55 * share**3) + 2.0 * (1 - share**2))
    turn = np.linspace(-np.pi, np.pi, config.columns, endpoint=False) + rng.uniform(0, 2 * np.pi / config.columns)
    elevation, azimuth = (grid.ravel() for grid in np.meshgrid(beams, turn))
    local = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    directions = np.ascontiguousarray(local @ world_from_lidar.rotation.T, np.float32)
    origin = world_from_lidar.translation.astype(np.float32)
    hits = scene.cast(np.tile(origin, (len(directions), 1)), directions)
    met = np.flatnonzero((hits.face >= 0) & (hits.distance_m < config.max_range_m) & (hits.distance_m > 0.5))
    face, range_m = hits.face[met], hits.distance_m[met]
    normal = scene.faces.normals[face].mean(axis=1)
    cosine = np.abs(np.einsum("ni,ni->n", normal, directions[met])) / (np.linalg.norm(normal, axis=1) + 1e-9)
    surface = scene.faces.surface[face]
    brightness = scene.faces.colour[face].mean(axis=1)
    painted = np.isin(surface, (Surface.BODYWORK, Surface.MASONRY, Surface.CLOTH, Surface.CANVAS, Surface.ASPHALT))
    reflectivity = surface_table().lidar[surface] * np.where(painted, 0.35 + brightness, 1.0)
    returned = reflectivity * np.sqrt(cosine)
    weakest = _WEAKEST * np.square(range_m / 50) * np.exp(rng.normal(0, 0.3, len(met)))
    kept = np.flatnonzero((returned > weakest) & (rng.random(len(met)) >= config.missed))
    noisy = range_m[kept] + config.range_noise_m * rng.standard_normal(len(kept))
    points = local[met[kept]] * noisy[:, None]
    intensity = np.clip(255 * returned[kept] * np.exp(rng.normal(0, 0.1, len(kept))), 0, 255)
    return {
        "x": points[:, 0].astype(np.float32),
        "y": points[:, 1].astype(np.float32),
        "z": points[:, 2].astype(np.float32),
        "intensity": intensity.astype(np.float32),
    }
