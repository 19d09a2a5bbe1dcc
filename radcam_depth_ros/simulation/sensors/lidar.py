"""Sweeps of a spinning LiDAR."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.materials.surfaces import Surface, surface_table
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.sensors.lidar_unit import Beams
from radcam_depth_ros.simulation.settings.sensor_configuration import LidarConfig

_NEAREST_M = 0.5
_PAINTED = (Surface.BODYWORK, Surface.MASONRY, Surface.CLOTH, Surface.CANVAS, Surface.ASPHALT)
_SOAKED = (Surface.ASPHALT, Surface.PAINT_MARK, Surface.PAVING, Surface.GROUND)


def sweep_lidar(
    scene: Scene,
    world_from_lidar: RigidTransform,
    config: LidarConfig,
    beams: Beams,
    wetness: float,
    rng: np.random.Generator,
) -> dict[str, npt.NDArray[np.generic]]:
    """One turn: x y z in metres in the sensor's frame and intensity 0 to 255, all float32.

    Glass sends little back, dark things far away nothing, a wet road little of what meets it at a grazing angle.

    Args:
        scene: The world at the turn's time.
        world_from_lidar: Pose of the sensor.
        config: Its noise and how many directions it measures.
        beams: Its beams and how weak an echo it sees.
        wetness: Of the ground, 0 dry to 1 wet.
        rng: Random generator.
    """
    local = _directions(beams, config.columns, rng.uniform(0, 2 * np.pi / config.columns))
    directions = local @ world_from_lidar.rotation.T.astype(np.float32)
    origin = world_from_lidar.translation.astype(np.float32)
    hits = scene.cast(np.broadcast_to(origin, directions.shape).copy(), directions)
    met = np.flatnonzero((hits.face >= 0) & (hits.distance_m < beams.max_range_m) & (hits.distance_m > _NEAREST_M))
    face, range_m = hits.face[met], hits.distance_m[met]
    cosine = np.abs(np.einsum("ni,ni->n", scene.faces.normals[face, 0], directions[met]))
    returned = _reflectivity(scene, face, wetness, cosine) * np.sqrt(cosine)
    needed = beams.weakest * np.square(range_m / 50) * np.exp(0.3 * rng.standard_normal(len(met), dtype=np.float32))
    kept = np.flatnonzero((returned > needed) & (rng.random(len(met), dtype=np.float32) >= config.missed))
    noise = config.range_noise_m * rng.standard_normal(len(kept), dtype=np.float32)
    points = local[met[kept]] * (range_m[kept] + noise)[:, None]
    intensity = 255 * returned[kept] * np.exp(0.1 * rng.standard_normal(len(kept), dtype=np.float32))
    return {
        "x": points[:, 0].astype(np.float32),
        "y": points[:, 1].astype(np.float32),
        "z": points[:, 2].astype(np.float32),
        "intensity": np.clip(intensity, 0, 255).astype(np.float32),
    }


def _directions(beams: Beams, columns: int, phase: float) -> FloatArray:
    elevation = np.deg2rad(beams.elevations_deg)[:, None]
    azimuth = (np.linspace(-np.pi, np.pi, columns, endpoint=False) + phase)[None]
    flat = np.cos(elevation)
    parts = np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation))
    return np.stack([part.ravel() for part in parts], axis=1).astype(np.float32)


def _reflectivity(scene: Scene, face: npt.NDArray[np.int32], wetness: float, cosine: FloatArray) -> FloatArray:
    surface = scene.faces.surface[face]
    painted, soaked = (np.isin(np.arange(len(Surface)), group)[surface] for group in (_PAINTED, _SOAKED))
    brightness = scene.faces.colour[face].mean(axis=1)
    # A film of water mirrors away what comes flat, and darkens what lies below it.
    film = 1 - np.float32(wetness) * (0.5 + 0.4 * (1 - cosine))
    share = np.where(painted, 0.35 + brightness, 1)
    return np.asarray(surface_table().lidar[surface] * share * np.where(soaked, film, 1), np.float32)
