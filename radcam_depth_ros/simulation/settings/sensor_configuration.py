"""Settings of the radars and the LiDAR: ranges from which each seed draws its sensors."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from radcam_depth_ros.simulation.settings.errors import require, require_pairs, require_positive_rate, require_ranges


class LidarUnit(str, Enum):
    """Spinning LiDARs on the market, by their elevations; ANY draws one for each seed."""

    ANY = "any"
    VLP_16 = "vlp_16"
    HDL_32E = "hdl_32e"
    VLP_32C = "vlp_32c"
    HDL_64E = "hdl_64e"
    OS1_64 = "os1_64"


@dataclass(frozen=True)
class RadarConfig:
    """An automotive radar like the ARS408: azimuth and range, no elevation, a far and a near scan.

    Attributes:
        enabled: Write its topic.
        rate_hz: Sweeps a second.
        min_points: Each seed draws how many of the strongest returns are kept at most, between this
        max_points: and this.
        max_range_m: Metres.
        min_field_of_view_deg: Each seed draws the width of the sector between this
        max_field_of_view_deg: and this, degrees.
        min_threshold_dbsm: Each seed draws the cross section that is just seen at 50 m between this
        max_threshold_dbsm: and this, dBsm.
        min_range_noise_m: Each seed draws the standard deviation of the range between this
        max_range_noise_m: and this, metres.
        min_azimuth_noise_deg: Each seed draws that of the azimuth of a weak return straight ahead between this
        max_azimuth_noise_deg: and this, degrees; it grows to the sides.
        speed_noise_mps: Standard deviation of the radial speed, m/s.
        min_missed: Each seed draws the share of returns that are lost at random between this
        max_missed: and this.
        min_clutter: Each seed draws how many returns from nothing a sweep has on average between this
        max_clutter: and this.
        max_ghosts: Each seed draws the share of returns that are seen again, doubled or late, between 0 and this.
        max_mirror: Each seed draws the share of the power that guard rails, walls and cars mirror between 0 and this.
        max_road_mirror: Each seed draws the share that comes back by way of the road between 0 and this.
        interference: Share of the sweeps that another radar disturbs with a burst of returns.
        material_spread_db: Standard deviation of how much stronger or weaker than the table a seed's radar sees each
            group of materials: ground, plants, metal, walls.
        max_clock_offset_s: Each seed's radar measures up to this much before or after its stamps say, seconds.
        clock_jitter_s: Standard deviation of each sweep's time besides, seconds.
        max_mounting_error_deg: Each seed turns the radar by up to this about each axis against its transform, degrees.
        max_mounting_error_m: Each seed moves it by up to this along each axis, metres.
        min_height_m: Each seed mounts it between this
        max_height_m: and this above the road, metres.
    """

    enabled: bool = True
    rate_hz: float = 13.0
    min_points: int = 50
    max_points: int = 125
    max_range_m: float = 200.0
    min_field_of_view_deg: float = 100.0
    max_field_of_view_deg: float = 120.0
    min_threshold_dbsm: float = -10.0
    max_threshold_dbsm: float = 0.0
    min_range_noise_m: float = 0.1
    max_range_noise_m: float = 0.4
    min_azimuth_noise_deg: float = 0.3
    max_azimuth_noise_deg: float = 1.2
    speed_noise_mps: float = 0.1
    min_missed: float = 0.05
    max_missed: float = 0.3
    min_clutter: float = 0.5
    max_clutter: float = 8.0
    max_ghosts: float = 0.1
    max_mirror: float = 0.2
    max_road_mirror: float = 0.4
    interference: float = 0.02
    material_spread_db: float = 4.0
    max_clock_offset_s: float = 0.03
    clock_jitter_s: float = 0.002
    max_mounting_error_deg: float = 0.5
    max_mounting_error_m: float = 0.05
    min_height_m: float = 0.35
    max_height_m: float = 0.8

    def __post_init__(self) -> None:
        _check_radar("radar", self)


@dataclass(frozen=True)
class ImagingRadarConfig(RadarConfig):
    """A 4D radar: it measures elevation too, and many more points.

    Attributes:
        min_elevation_noise_deg: Each seed draws the standard deviation of a weak return's elevation between this
        max_elevation_noise_deg: and this, degrees; strong returns have less than half of it.
        min_range_cell_m: Each seed draws the range resolution between this
        max_range_cell_m: and this, metres.
        min_azimuth_cell_deg: Each seed draws the azimuth resolution straight ahead between this
        max_azimuth_cell_deg: and this, degrees.
        max_spread: Each seed draws how many more returns a strong cell gives for each 10 dB between 0 and this.
        min_speed_span_mps: Each seed draws the unambiguous span of radial speeds between this
        max_speed_span_mps: and this, m/s; other speeds are folded into it.
        max_intensity_offset_db: Each seed's intensity is the cross section, or the level in noise, with an offset
            between 0 and this, dB.
    """

    rate_hz: float = 15.0
    min_points: int = 200
    max_points: int = 6000
    max_range_m: float = 150.0
    min_field_of_view_deg: float = 80.0
    max_field_of_view_deg: float = 130.0
    min_threshold_dbsm: float = -28.0
    max_threshold_dbsm: float = -12.0
    min_range_noise_m: float = 0.03
    max_range_noise_m: float = 0.25
    min_azimuth_noise_deg: float = 0.2
    max_azimuth_noise_deg: float = 1.5
    speed_noise_mps: float = 0.06
    min_clutter: float = 4.0
    max_clutter: float = 500.0
    max_ghosts: float = 0.25
    max_mirror: float = 0.3
    material_spread_db: float = 7.0
    max_height_m: float = 1.9
    min_elevation_noise_deg: float = 0.4
    max_elevation_noise_deg: float = 8.0
    min_range_cell_m: float = 0.15
    max_range_cell_m: float = 0.8
    min_azimuth_cell_deg: float = 0.7
    max_azimuth_cell_deg: float = 2.5
    max_spread: float = 8.0
    min_speed_span_mps: float = 8.0
    max_speed_span_mps: float = 160.0
    max_intensity_offset_db: float = 60.0

    def __post_init__(self) -> None:
        _check_radar("imaging_radar", self)
        require_pairs(
            "imaging_radar",
            self,
            {
                "elevation_noise_deg": (0, 20),
                "range_cell_m": (0.02, 5),
                "azimuth_cell_deg": (0.1, 20),
                "speed_span_mps": (1, 1000),
            },
        )
        require_ranges("imaging_radar", self, {"max_spread": (0, 50), "max_intensity_offset_db": (0, 200)})


@dataclass(frozen=True)
class LidarConfig:
    """A spinning LiDAR.

    Attributes:
        enabled: Write `/lidar/points`.
        rate_hz: Turns a second; each turn is taken at one time.
        unit: Which one: its beams, its range and how weak an echo it sees.
        beams: So many beams, evenly over the unit's span, in place of its own; null for its own.
        columns: Directions in a turn.
        max_range_m: Metres, where the unit does not end before.
        range_noise_m: Standard deviation, metres.
        missed: Share of the returns that are lost at random.
        min_height_m: Each seed mounts it between this
        max_height_m: and this above the road, metres.
    """

    enabled: bool = True
    rate_hz: float = 10.0
    unit: LidarUnit = LidarUnit.ANY
    beams: int | None = None
    columns: int = 1000
    max_range_m: float = 200.0
    range_noise_m: float = 0.02
    missed: float = 0.03
    min_height_m: float = 1.6
    max_height_m: float = 2.2

    def __post_init__(self) -> None:
        require_positive_rate("lidar", self.rate_hz)
        require(
            (self.beams is None or 1 <= self.beams <= 256) and 16 <= self.columns <= 8192,
            f"lidar.beams must be 1 to 256 or null and lidar.columns 16 to 8192, got {self.beams} and {self.columns}",
        )
        require_ranges("lidar", self, {"max_range_m": (1, 500), "range_noise_m": (0, 1), "missed": (0, 1)})
        require_pairs("lidar", self, {"height_m": (0.2, 5)})


_RADAR_PAIRS = {
    "points": (1, 20000),
    "field_of_view_deg": (10, 160),
    "threshold_dbsm": (-60, 60),
    "range_noise_m": (0, 5),
    "azimuth_noise_deg": (0, 20),
    "missed": (0, 1),
    "clutter": (0, 5000),
    "height_m": (0.1, 5),
}
_RADAR_RANGES = {
    "max_range_m": (10, 500),
    **dict.fromkeys(("max_ghosts", "max_mirror", "max_road_mirror", "interference"), (0, 1)),
    "speed_noise_mps": (0, 10),
    "material_spread_db": (0, 20),
    "max_clock_offset_s": (0, 0.2),
    "clock_jitter_s": (0, 0.05),
    "max_mounting_error_deg": (0, 10),
    "max_mounting_error_m": (0, 1),
}


def _check_radar(sensor: str, config: RadarConfig) -> None:
    require_positive_rate(sensor, config.rate_hz)
    require_pairs(sensor, config, _RADAR_PAIRS)
    require_ranges(sensor, config, _RADAR_RANGES)
