"""Draws the radar of a seed from the ranges of its configuration."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.materials.surfaces import Surface, surface_table
from radcam_depth_ros.simulation.settings.sensor_configuration import ImagingRadarConfig, RadarConfig

_GROUPS = (
    (Surface.ASPHALT, Surface.PAINT_MARK, Surface.PAVING, Surface.GROUND),
    (Surface.FOLIAGE, Surface.WOOD),
    (Surface.METAL, Surface.SIGN_FACE),
    (Surface.MASONRY, Surface.ROOF),
)
"""Materials of which a radar sees all more or all less than another radar; the rest is as in the table."""


@dataclass(frozen=True)
class Reflectivity:
    """Cross section of each `Surface` for each square metre, as columns indexed by its value.

    Attributes:
        normal_db: (S,) float32, dB at normal incidence.
        grazing_db: (S,) float32, dB at grazing incidence.
    """

    normal_db: FloatArray
    grazing_db: FloatArray


@dataclass(frozen=True)
class RadarUnit:
    """A radar as drawn; a `RadarConfig` explains what each value means.

    Attributes:
        config: The settings that it was drawn from, for values that no seed draws.
        max_points: So many returns are kept.
        half_view: Half the width of the sector, radians.
        threshold_dbsm: Cross section that is just seen at 50 m.
        range_noise_m: Standard deviation.
        azimuth_noise: Standard deviation of a weak return straight ahead, radians.
        missed: Share that is lost.
        clutter: Returns from nothing on average.
        ghosts: Share that is seen again.
        mirror: Share of the power by way of upright surfaces.
        road_mirror: Share of the power by way of the road.
        reflectivity: How it sees materials.
        clock_offset_s: It measures so much after what its stamps say.
        mount_from_radar: How it truly sits in the frame that its transform tells of.
    """

    config: RadarConfig
    max_points: int
    half_view: float
    threshold_dbsm: float
    range_noise_m: float
    azimuth_noise: float
    missed: float
    clutter: float
    ghosts: float
    mirror: float
    road_mirror: float
    reflectivity: Reflectivity
    clock_offset_s: float
    mount_from_radar: RigidTransform

    def delay_s(self, rng: np.random.Generator) -> float:
        """How long after its stamp a sweep is taken."""
        return self.clock_offset_s + self.config.clock_jitter_s * float(rng.standard_normal())


@dataclass(frozen=True)
class ImagingRadarUnit(RadarUnit):
    """A 4D radar as it is.

    Attributes:
        elevation_noise: Standard deviation of a weak return, radians.
        range_cell_m: Range resolution.
        azimuth_cell: Resolution of the azimuth straight ahead, radians.
        spread: Returns more of a strong cell for each 10 dB.
        speed_span_mps: Unambiguous span of radial speeds.
        intensity_offset_db: Added to the intensity.
        intensity_is_level: Whether the intensity is the level above the threshold, in place of the cross section.
    """

    elevation_noise: float
    range_cell_m: float
    azimuth_cell: float
    spread: float
    speed_span_mps: float
    intensity_offset_db: float
    intensity_is_level: bool


def draw_radar(config: RadarConfig, rng: np.random.Generator) -> RadarUnit:
    """Draws a radar without elevation."""
    draws = _Draws(config, rng)
    return RadarUnit(
        config=config,
        max_points=round(draws.by_magnitude("points")),
        half_view=float(np.deg2rad(draws.even("field_of_view_deg") / 2)),
        threshold_dbsm=draws.even("threshold_dbsm"),
        range_noise_m=draws.even("range_noise_m"),
        azimuth_noise=float(np.deg2rad(draws.by_magnitude("azimuth_noise_deg"))),
        missed=draws.even("missed"),
        clutter=draws.by_magnitude("clutter"),
        ghosts=draws.up_to(config.max_ghosts),
        mirror=draws.up_to(config.max_mirror),
        road_mirror=draws.up_to(config.max_road_mirror),
        reflectivity=_draw_reflectivity(config.material_spread_db, rng),
        clock_offset_s=rng.uniform(-1, 1) * config.max_clock_offset_s,
        mount_from_radar=_draw_mounting_error(config, rng),
    )


def draw_imaging_radar(config: ImagingRadarConfig, rng: np.random.Generator) -> ImagingRadarUnit:
    """Draws a 4D radar."""
    common, draws = draw_radar(config, rng), _Draws(config, rng)
    return ImagingRadarUnit(
        **{entry.name: getattr(common, entry.name) for entry in fields(RadarUnit)},
        elevation_noise=float(np.deg2rad(draws.by_magnitude("elevation_noise_deg"))),
        range_cell_m=draws.by_magnitude("range_cell_m"),
        azimuth_cell=float(np.deg2rad(draws.by_magnitude("azimuth_cell_deg"))),
        spread=draws.up_to(config.max_spread),
        speed_span_mps=draws.by_magnitude("speed_span_mps"),
        intensity_offset_db=draws.up_to(config.max_intensity_offset_db),
        intensity_is_level=bool(rng.random() < 0.5),
    )


class _Draws:
    """Values between a setting's `min_` and `max_`; each takes one number, so that changing one leaves the others."""

    def __init__(self, config: RadarConfig, rng: np.random.Generator) -> None:
        self._config, self._rng = config, rng

    def even(self, name: str) -> float:
        low, high = self._range(name)
        return low + (high - low) * self._rng.random()

    def by_magnitude(self, name: str) -> float:
        """Even in the logarithm: as likely between 1 and 2 as between 2 and 4."""
        low, high = self._range(name)
        share = self._rng.random()
        return float(low * (high / low) ** share) if low > 0 else high * share

    def up_to(self, high: float) -> float:
        return high * self._rng.random()

    def _range(self, name: str) -> tuple[float, float]:
        return float(getattr(self._config, f"min_{name}")), float(getattr(self._config, f"max_{name}"))


def _draw_reflectivity(spread_db: float, rng: np.random.Generator) -> Reflectivity:
    table, offset_db = surface_table(), np.zeros(len(Surface), np.float32)
    for group, more_db in zip(_GROUPS, spread_db * rng.standard_normal(len(_GROUPS)), strict=True):
        offset_db[list(group)] = more_db
    return Reflectivity(table.radar_db + offset_db, table.radar_diffuse_db + offset_db)


def _draw_mounting_error(config: RadarConfig, rng: np.random.Generator) -> RigidTransform:
    turn = np.deg2rad(config.max_mounting_error_deg) * rng.uniform(-1, 1, 3)
    shift = config.max_mounting_error_m * rng.uniform(-1, 1, 3)
    return RigidTransform.from_quaternion(shift, [*np.sin(turn / 2), 1.0])
