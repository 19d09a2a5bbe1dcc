"""What a radar's waves come back from: fans of rays, weighed by cross section, gathered in resolution cells."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.scene import Scene
from radcam_depth_ros.simulation.surfaces import Surface, surface_table

_MIRROR_REACH_M = 80.0


@dataclass(frozen=True)
class Echoes:
    """Echoes as columns, in the sensor's frame (x forward, y left, z up).

    Attributes:
        range_m: (N,) float32.
        azimuth: (N,) float32, radians to the left.
        elevation: (N,) float32, radians upwards.
        section_m2: (N,) float32, radar cross section.
        speed_mps: (N,) float32, radial speed against the sensor, positive moving away.
        ground_speed_mps: (N,) float32, the same against the ground.
    """

    range_m: FloatArray
    azimuth: FloatArray
    elevation: FloatArray
    section_m2: FloatArray
    speed_mps: FloatArray
    ground_speed_mps: FloatArray

    def __len__(self) -> int:
        return len(self.range_m)

    def some(self, chosen: npt.NDArray[np.integer] | npt.NDArray[np.bool_]) -> Echoes:
        """The echoes that an index or a mask names."""
        return Echoes(**{field.name: getattr(self, field.name)[chosen] for field in fields(Echoes)})

    def joined(self, other: Echoes) -> Echoes:
        """These and others."""
        return Echoes(
            **{
                field.name: np.concatenate([getattr(self, field.name), getattr(other, field.name)])
                for field in fields(Echoes)
            }
        )


@dataclass(frozen=True)
class Fan:
    """The directions in which a radar looks.

    Attributes:
        azimuths: (A,) float32 radians, evenly spaced.
        elevations: (E,) float32 radians, evenly spaced.
    """

    azimuths: FloatArray
    elevations: FloatArray

    @classmethod
    def of_degrees(cls, half_azimuth: float, columns: int, low: float, high: float, rows: int) -> Fan:
        """An even fan; all angles in degrees."""
        return cls(
            np.deg2rad(np.linspace(-half_azimuth, half_azimuth, columns)).astype(np.float32),
            np.deg2rad(np.linspace(low, high, rows)).astype(np.float32),
        )


def trace(
    scene: Scene,
    world_from_sensor: RigidTransform,
    sensor_velocity: npt.NDArray[np.floating],
    fan: Fan,
    max_range_m: float,
    mirror_loss: float,
    rng: np.random.Generator,
) -> Echoes:
    """One echo for each ray of a fan that meets something, directly or by way of the road.

    Args:
        scene: The world at the sweep's time.
        world_from_sensor: Pose of the sensor.
        sensor_velocity: (3,) m/s in world axes.
        fan: Directions; each ray is moved at random within its share of the fan.
        max_range_m: Echoes from further away are left out.
        mirror_loss: Share of the power that is left of echoes by way of the road.
        rng: Random generator.
    """
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(fan.azimuths, fan.elevations))
    steps = (fan.azimuths[1] - fan.azimuths[0], fan.elevations[1] - fan.elevations[0])
    azimuth = azimuth + steps[0] * (rng.random(azimuth.shape, dtype=np.float32) - np.float32(0.5))
    elevation = elevation + steps[1] * (rng.random(azimuth.shape, dtype=np.float32) - np.float32(0.5))
    local = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    directions = np.ascontiguousarray(local @ world_from_sensor.rotation.T, np.float32)
    origin = world_from_sensor.translation.astype(np.float32)
    hits = scene.cast(np.tile(origin, (len(directions), 1)), directions)
    face, range_m = hits.face.copy(), hits.distance_m.copy()
    arriving = directions.copy()
    share = np.ones(len(face), np.float32)
    # The road is a mirror at these angles: that is how a radar sees below the vehicle in front.
    road = np.flatnonzero((face >= 0) & (range_m < _MIRROR_REACH_M))
    road = road[np.isin(scene.faces.surface[face[road]], (Surface.ASPHALT, Surface.PAINT_MARK))]
    if len(road):
        start = origin + directions[road] * range_m[road, None]
        start[:, 2] += 2e-3
        arriving[road, 2] *= -1
        beyond = scene.cast(np.ascontiguousarray(start), np.ascontiguousarray(arriving[road]))
        face[road] = beyond.face
        range_m[road] += beyond.distance_m
        share[road] = mirror_loss
    seen = np.flatnonzero((face >= 0) & (range_m < max_range_m) & (range_m > 0.3))
    face, range_m, arriving = face[seen], range_m[seen], arriving[seen]
    section = _cross_section(scene, face, arriving, range_m, steps) * share[seen]
    section *= rng.exponential(1.0, len(seen)).astype(np.float32)
    outwards = directions[seen]
    ground_speed = np.einsum("ni,ni->n", scene.velocity[face], outwards)
    speed = ground_speed - outwards @ np.asarray(sensor_velocity, np.float32)
    return Echoes(range_m, azimuth[seen], elevation[seen], section.astype(np.float32), speed, ground_speed)


def _cross_section(
    scene: Scene, face: npt.NDArray[np.int32], directions: FloatArray, range_m: FloatArray, steps: tuple[float, float]
) -> FloatArray:
    """Square metres: reflectivity of the surface at this angle, times the area that one ray stands for."""
    table = surface_table()
    normal = scene.faces.normals[face].mean(axis=1)
    cosine = np.abs(np.einsum("ni,ni->n", normal, directions)) / (np.linalg.norm(normal, axis=1) + 1e-9)
    surface = scene.faces.surface[face]
    flat, grazing = table.radar_db[surface], table.radar_diffuse_db[surface]
    reflectivity = 10 ** ((grazing + (flat - grazing) * cosine**8) / 10)
    area = np.square(range_m) * abs(steps[0] * steps[1]) / np.maximum(cosine, 0.1)
    return np.asarray(reflectivity * area, np.float32)


def gather(
    echoes: Echoes, range_cell_m: float, azimuth_cell: float, elevation_cell: float, speed_cell_mps: float
) -> Echoes:
    """Merges the echoes of each resolution cell: sections add up, the rest is their weighted mean."""
    if not len(echoes):
        return echoes
    keys = np.stack(
        [
            np.round(echoes.range_m / range_cell_m),
            np.round(echoes.azimuth / azimuth_cell),
            np.round(echoes.elevation / elevation_cell),
            np.round(echoes.speed_mps / speed_cell_mps),
        ],
        axis=1,
    ).astype(np.int64)
    flat = ((keys[:, 0] * 4096 + keys[:, 1]) * 4096 + keys[:, 2]) * 4096 + keys[:, 3]
    _, cell = np.unique(flat, return_inverse=True)
    total = np.bincount(cell, echoes.section_m2)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(cell, echoes.section_m2 * values) / np.maximum(total, 1e-20), np.float32)

    return Echoes(
        mean(echoes.range_m),
        mean(echoes.azimuth),
        mean(echoes.elevation),
        np.asarray(total, np.float32),
        mean(echoes.speed_mps),
        mean(echoes.ground_speed_mps),
    )


def detected(echoes: Echoes, threshold_db: float, missed: float, max_points: int, rng: np.random.Generator) -> Echoes:
    """The cells that stand out of the noise, the strongest where there are too many.

    Args:
        echoes: Cells.
        threshold_db: Cross section in dBsm that is just seen at 50 m. Nearer it falls slowly: a radar damps what
            is near, or it would see every blade of grass.
        missed: Share that is lost at random.
        max_points: At most so many are kept.
        rng: Random generator.
    """
    decades = np.log10(np.maximum(echoes.range_m, 1.0) / 50)
    level = 10 * np.log10(np.maximum(echoes.section_m2, 1e-9)) - np.where(decades > 0, 40, 12) * decades
    level = level + rng.normal(0, 2.0, len(level))
    seen = np.flatnonzero((level > threshold_db) & (rng.random(len(level)) >= missed))
    strongest = seen[np.argsort(-level[seen], kind="stable")[:max_points]]
    return echoes.some(np.sort(strongest))


def with_false_echoes(
    echoes: Echoes,
    ghosts: float,
    clutter: float,
    max_range_m: float,
    half_azimuth: float,
    max_points: int,
    rng: np.random.Generator,
) -> Echoes:
    """Adds echoes from nothing, and second ones of some echoes by way of something else.

    Args:
        echoes: What was detected.
        ghosts: Share of echoes that are seen twice.
        clutter: Number of echoes from nothing, on average.
        max_range_m: Nothing is further away.
        half_azimuth: Nothing is further to the side, radians.
        max_points: So many are kept, true ones or not.
        rng: Random generator.
    """
    strong = np.flatnonzero(rng.random(len(echoes)) < ghosts)
    mirrored = echoes.some(strong)
    twice = rng.random(len(strong)) < 0.4
    longer = np.where(twice, 2 * mirrored.range_m, mirrored.range_m + rng.uniform(0.5, 15, len(strong)))
    turned = np.where(twice, mirrored.azimuth, mirrored.azimuth + rng.normal(0, 0.15, len(strong)))
    doubled = np.where(twice, 2.0, 1.0)
    ghost = Echoes(
        longer.astype(np.float32),
        np.clip(turned, -half_azimuth, half_azimuth).astype(np.float32),
        mirrored.elevation,
        mirrored.section_m2 * np.float32(0.1),
        (mirrored.speed_mps * doubled).astype(np.float32),
        (mirrored.ground_speed_mps * doubled).astype(np.float32),
    )
    count = int(rng.poisson(clutter))
    nothing = Echoes(
        rng.uniform(2, max_range_m, count).astype(np.float32),
        rng.uniform(-half_azimuth, half_azimuth, count).astype(np.float32),
        rng.uniform(-0.05, 0.1, count).astype(np.float32),
        (10 ** rng.uniform(-1.2, 0.5, count)).astype(np.float32),
        rng.normal(0, 8, count).astype(np.float32),
        rng.normal(0, 8, count).astype(np.float32),
    )
    everything = echoes.joined(ghost.some(ghost.range_m < max_range_m)).joined(nothing)
    return everything.some(np.sort(rng.permutation(len(everything))[:max_points]))
