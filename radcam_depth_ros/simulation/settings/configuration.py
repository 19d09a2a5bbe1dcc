"""Settings of a simulated drive; the defaults are those of config/simulation.yaml."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from radcam_depth_ros.simulation.settings.errors import require, require_pairs, require_positive_rate, require_ranges
from radcam_depth_ros.simulation.settings.looks import LooksConfig
from radcam_depth_ros.simulation.settings.sensor_configuration import ImagingRadarConfig, LidarConfig, RadarConfig


class StreetKind(str, Enum):
    """Kind of street, by the land beside it or its special feature; ANY draws one for each seed."""

    ANY = "any"
    TOWN = "town"
    RESIDENTIAL = "residential"
    ARTERIAL = "arterial"
    RURAL = "rural"
    HIGHWAY = "highway"
    JUNCTION = "junction"
    CAR_PARK = "car_park"
    TUNNEL = "tunnel"
    CONSTRUCTION = "construction"


class Weather(str, Enum):
    """Sky and air; ANY draws one for each seed."""

    ANY = "any"
    SUNNY = "sunny"
    CLOUDY = "cloudy"
    OVERCAST = "overcast"
    RAIN = "rain"
    FOG = "fog"


class TimeOfDay(str, Enum):
    """How high the sun stands; ANY draws one for each seed."""

    ANY = "any"
    DAY = "day"
    DUSK = "dusk"
    NIGHT = "night"


class Season(str, Enum):
    """Season, which decides leaves and snow; ANY draws one for each seed."""

    ANY = "any"
    SUMMER = "summer"
    AUTUMN = "autumn"
    WINTER = "winter"
    SNOW = "snow"


@dataclass(frozen=True)
class WorldConfig:
    """The street and who is on it.

    Attributes:
        street: Kind of street.
        weather: Sky and air.
        time_of_day: Day, dusk or night.
        season: Season.
        traffic: Moving vehicles, as a multiple of what the kind of street has; 0 for none.
        parked: Parked vehicles, likewise.
        people: People on foot and on bicycles, likewise.
        speed: Speed of the ego vehicle and of traffic, as a multiple of what the kind of street has; 0 stands still.
        max_slope: The steepest that hills may be, metres of rise a metre, and banks of curves; 0 keeps the road flat.
        random_textures: Share of the seeds whose patterns and colours are drawn without regard to what they are on.
        view_m: How far ahead the street is built, metres.
        random_light: Share of the seeds with light that no weather gives: flat, coloured, without shadows, and with
            random tones in the camera.
        wires: Share of the seeds with wires along the road, where the kind of street has not more of its own.
    """

    street: StreetKind = StreetKind.ANY
    weather: Weather = Weather.ANY
    time_of_day: TimeOfDay = TimeOfDay.ANY
    season: Season = Season.ANY
    traffic: float = 1.0
    parked: float = 1.0
    people: float = 1.0
    speed: float = 1.0
    max_slope: float = 0.08
    random_textures: float = 0.04
    view_m: float = 400.0
    random_light: float = 0.04
    wires: float = 0.0

    def __post_init__(self) -> None:
        multiples = dict.fromkeys(("traffic", "parked", "people", "speed"), (0, 4))
        shares = dict.fromkeys(("random_textures", "random_light", "wires"), (0, 1))
        require_ranges("world", self, {**multiples, **shares, "max_slope": (0, 0.2), "view_m": (100, 1500)})


@dataclass(frozen=True)
class CameraConfig:
    """The camera and how its images are made.

    Attributes:
        rate_hz: Images a second.
        width: Pixels; the most where `min_width` is set.
        height: Pixels; the most where `min_height` is set.
        min_width: Each seed draws a width between this and `width`; 0 for always `width`.
        min_height: Each seed draws a height between this and `height`; 0 for always `height`.
        min_focal_length_px: Each seed draws a focal length between this
        max_focal_length_px: and this, pixels.
        min_height_m: Each seed mounts the camera between this
        max_height_m: and this above the road, metres.
        usual_height_m: Height that is likeliest between these two, metres, see `rig`; 0 for all as likely.
        max_pitch_deg: Each seed tilts it by up to this, degrees; rolls by a third of it.
        edge_samples: More rays for each pixel at an edge, against stairs; 0 for none.
        jpeg: Write CompressedImage; otherwise Image, rgb8.
        min_jpeg_quality: Each seed draws a quality between this
        max_jpeg_quality: and this.
        depth: Write the exact depth image.
        classes: Write the class image: training ids of Cityscapes, 254 for wires, 255 for what has none.
    """

    rate_hz: float = 10.0
    width: int = 800
    height: int = 448
    min_width: int = 0
    min_height: int = 0
    min_focal_length_px: float = 630.0
    max_focal_length_px: float = 630.0
    min_height_m: float = 1.0
    max_height_m: float = 2.5
    usual_height_m: float = 0.0
    max_pitch_deg: float = 3.0
    edge_samples: int = 2
    jpeg: bool = True
    min_jpeg_quality: int = 60
    max_jpeg_quality: int = 96
    depth: bool = True
    classes: bool = True

    def __post_init__(self) -> None:
        require_positive_rate("camera", self.rate_hz)
        sides = dict.fromkeys(("width", "height"), (16, 4096))
        require_ranges("camera", self, {**sides, "max_pitch_deg": (0, 20), "edge_samples": (0, 8)})
        sizes = {"focal_length_px": (10, 10000), "height_m": (0.3, 4), "jpeg_quality": (1, 100)}
        require_pairs("camera", self, sizes)
        require(
            self.usual_height_m == 0 or self.min_height_m <= self.usual_height_m <= self.max_height_m,
            "camera.usual_height_m must be 0 (all heights as likely) or lie between min_height_m and max_height_m, got "
            f"{self.usual_height_m}",
        )
        for name in ("width", "height"):
            least_px, most_px = getattr(self, f"min_{name}"), getattr(self, name)
            require(
                least_px == 0 or 16 <= least_px <= most_px,
                f"camera.min_{name} must be 0 (always camera.{name}) or 16 to camera.{name}, which is {most_px}, "
                f"got {least_px}",
            )


@dataclass(frozen=True)
class OdometryConfig:
    """Wheel odometry.

    Attributes:
        enabled: Write `/odom` and `/tf`.
        rate_hz: Messages a second.
        speed_noise_mps: Standard deviation of the speed, m/s.
    """

    enabled: bool = True
    rate_hz: float = 50.0
    speed_noise_mps: float = 0.02

    def __post_init__(self) -> None:
        require_positive_rate("odometry", self.rate_hz)


@dataclass(frozen=True)
class SimulationConfig:
    """A simulated drive.

    Attributes:
        world: The street and who is on it.
        looks: What pictures have, each in its share of the seeds.
        camera: The camera.
        radar: The radar without elevation.
        imaging_radar: The 4D radar.
        lidar: The LiDAR.
        odometry: The odometry.
        key_frames: Write of each sensor only the sweep nearest to each image, so that images seconds apart cost no
            sweeps that nobody pairs.
        start_s: Time of the first image, seconds since 1970.
    """

    world: WorldConfig = field(default_factory=WorldConfig)
    looks: LooksConfig = field(default_factory=LooksConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    radar: RadarConfig = field(default_factory=RadarConfig)
    imaging_radar: ImagingRadarConfig = field(default_factory=ImagingRadarConfig)
    lidar: LidarConfig = field(default_factory=LidarConfig)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    key_frames: bool = False
    start_s: float = 1700000000.0

    def __post_init__(self) -> None:
        require(1 <= self.start_s < 4e9, f"start_s must be 1 to 4e9 seconds since 1970, got {self.start_s}")
        fastest = max(self.radar.rate_hz, self.imaging_radar.rate_hz, self.lidar.rate_hz, self.odometry.rate_hz)
        require(fastest <= 1000, f"no sensor may be faster than 1000 Hz, got {fastest}")
