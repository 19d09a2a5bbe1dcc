"""Traces a radar's echoes: fans of rays, weighed by cross section, on the direct way and by mirrors."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.materials.surfaces import Surface
from radcam_depth_ros.simulation.objects.scene import Hits, Scene
from radcam_depth_ros.simulation.sensors.radar_unit import RadarUnit, Reflectivity

_MIRROR_REACH_M = 80.0
_NEAREST_M = 0.3
# Between an upright mirror's plane and the ray, at most: steeper, a surface sends back instead of on.
_GRAZING = 0.6
_ROAD = (Surface.ASPHALT, Surface.PAINT_MARK)
_UPRIGHT_MIRRORS = (Surface.METAL, Surface.MASONRY, Surface.GLASS, Surface.BODYWORK, Surface.CANVAS)


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
        return Echoes(*(column[chosen] for column in self._columns()))

    def joined(self, *others: Echoes) -> Echoes:
        """These and others, in order."""
        parts = (self._columns(), *(other._columns() for other in others))
        return Echoes(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _columns(self) -> tuple[FloatArray, ...]:
        return tuple(getattr(self, field.name) for field in fields(Echoes))


@dataclass(frozen=True)
class Fan:
    """The directions in which a radar looks.

    Attributes:
        azimuths: (A,) float32 radians, evenly spaced.
        elevations: (E,) float32 radians, closest around the horizon, where far things are.
        steps: (E,) float32 radians, the height of each row.
    """

    azimuths: FloatArray
    elevations: FloatArray
    steps: FloatArray

    @classmethod
    def around_horizon(cls, half_view: float, columns: int, low: float, high: float, rows: int) -> Fan:
        """A fan; all angles in radians.

        Args:
            half_view: Half the width of the sector.
            columns: Number of azimuths, at least 2.
            low: Lowest elevation, negative.
            high: Highest elevation, positive.
            rows: Number of elevations.
        """
        scale = np.deg2rad(4.0)
        edges = scale * np.sinh(np.linspace(np.arcsinh(low / scale), np.arcsinh(high / scale), rows + 1))
        return cls(
            np.linspace(-half_view, half_view, columns).astype(np.float32),
            ((edges[1:] + edges[:-1]) / 2).astype(np.float32),
            np.diff(edges).astype(np.float32),
        )


def trace(
    scene: Scene,
    world_from_sensor: RigidTransform,
    sensor_velocity: npt.NDArray[np.floating],
    fan: Fan,
    unit: RadarUnit,
    rng: np.random.Generator,
) -> Echoes:
    """One echo for each ray of a fan that meets something, and one more where that is a mirror and shows something.

    Args:
        scene: The world at the sweep's time.
        world_from_sensor: Pose of the sensor.
        sensor_velocity: (3,) m/s in world axes.
        fan: Directions; each ray is moved at random within its share of the fan.
        unit: How far the radar sees, and how well it sees materials and their mirror images.
        rng: Random generator.
    """
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(fan.azimuths, fan.elevations))
    width, height = fan.azimuths[1] - fan.azimuths[0], np.repeat(fan.steps, len(fan.azimuths))
    azimuth = azimuth + width * (rng.random(azimuth.shape, dtype=np.float32) - np.float32(0.5))
    elevation = elevation + height * (rng.random(azimuth.shape, dtype=np.float32) - np.float32(0.5))
    solid_angle = width * height
    flat = np.cos(elevation)
    local = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    outwards = np.ascontiguousarray(local @ world_from_sensor.rotation.T.astype(np.float32), np.float32)
    origin = world_from_sensor.translation.astype(np.float32)
    hits = scene.cast(np.broadcast_to(origin, outwards.shape).copy(), outwards)
    ray, face, range_m, arriving, share = _with_mirrored(scene, hits, origin, outwards, unit)
    section = _cross_section(scene, face, arriving, range_m, solid_angle[ray], unit.reflectivity) * share
    # Many small scatterers in each patch: its power fluctuates as Swerling's first case does.
    section *= rng.standard_exponential(len(ray), dtype=np.float32)
    ground_speed = np.einsum("ni,ni->n", scene.velocity[face], arriving)
    speed = ground_speed - outwards[ray] @ np.asarray(sensor_velocity, np.float32)
    return Echoes(range_m, azimuth[ray], elevation[ray], section, speed, ground_speed)


def _with_mirrored(
    scene: Scene, hits: Hits, origin: FloatArray, outwards: FloatArray, unit: RadarUnit
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int32], FloatArray, FloatArray, FloatArray]:
    """Of direct and mirrored echoes: ray, face, range, direction in which it is met, and share of the power."""
    reach_m = unit.config.max_range_m
    seen = np.flatnonzero((hits.face >= 0) & (hits.distance_m < reach_m) & (hits.distance_m > _NEAREST_M))
    face, range_m = hits.face[seen], hits.distance_m[seen]
    surface = scene.faces.surface[face]
    # The road is a mirror at these angles: that is how a radar sees below the vehicle in front. Rails and walls are
    # mirrors for who drives along them: what they show lies behind them.
    near = range_m < _MIRROR_REACH_M
    on_road = np.flatnonzero(near & np.isin(surface, _ROAD))
    upright = np.flatnonzero(near & np.isin(surface, _UPRIGHT_MIRRORS))
    normal = scene.faces.normals[face[upright], 0]
    along = np.einsum("ni,ni->n", normal, outwards[seen[upright]])
    grazing = (np.abs(along) < _GRAZING) & (np.abs(normal[:, 2]) < 0.5)
    upright, normal, along = upright[grazing], normal[grazing], along[grazing]
    reflected = outwards[seen[on_road]].copy()
    reflected[:, 2] *= -1
    mirror = np.concatenate([on_road, upright])
    if not len(mirror):
        return seen, face, range_m, outwards[seen], np.ones(len(seen), np.float32)
    onwards = np.concatenate([reflected, outwards[seen[upright]] - 2 * along[:, None] * normal])
    ray = seen[mirror]
    start = origin + outwards[ray] * (range_m[mirror, None] - np.float32(2e-3))
    beyond = scene.cast(np.ascontiguousarray(start, np.float32), np.ascontiguousarray(onwards, np.float32))
    total = range_m[mirror] + beyond.distance_m
    loss = np.repeat(np.array([unit.road_mirror, unit.mirror], np.float32), [len(on_road), len(upright)])
    met = np.flatnonzero((beyond.face >= 0) & (total < reach_m))
    return (
        np.concatenate([seen, ray[met]]),
        np.concatenate([face, beyond.face[met]]),
        np.concatenate([range_m, total[met]]),
        np.concatenate([outwards[seen], onwards[met]]),
        np.concatenate([np.ones(len(seen), np.float32), loss[met]]),
    )


def _cross_section(
    scene: Scene,
    face: npt.NDArray[np.int32],
    directions: FloatArray,
    range_m: FloatArray,
    solid_angle: FloatArray,
    reflectivity: Reflectivity,
) -> FloatArray:
    """Square metres: reflectivity of the surface at this angle, times the area that one ray stands for."""
    cosine = np.minimum(np.abs(np.einsum("ni,ni->n", scene.faces.normals[face, 0], directions)), 1)
    surface = scene.faces.surface[face]
    normal, grazing = reflectivity.normal_db[surface], reflectivity.grazing_db[surface]
    area = np.square(range_m) * solid_angle / np.maximum(cosine, 0.1)
    return np.asarray(10 ** ((grazing + (normal - grazing) * np.square(np.square(np.square(cosine)))) / 10) * area)
