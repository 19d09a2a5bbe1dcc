"""Simulated drives: a street, a vehicle with camera, radars and LiDAR, and the bag of their measurements."""

from radcam_depth_ros.simulation.drives import simulate_drives
from radcam_depth_ros.simulation.materials.surfaces import Label
from radcam_depth_ros.simulation.recording import simulate
from radcam_depth_ros.simulation.settings.configuration import (
    CameraConfig,
    OdometryConfig,
    Season,
    SimulationConfig,
    StreetKind,
    TimeOfDay,
    Weather,
    WorldConfig,
)
from radcam_depth_ros.simulation.settings.errors import SimulationError
from radcam_depth_ros.simulation.settings.sensor_configuration import (
    ImagingRadarConfig,
    LidarConfig,
    LidarUnit,
    RadarConfig,
)

__all__ = [
    "CameraConfig",
    "ImagingRadarConfig",
    "Label",
    "LidarConfig",
    "LidarUnit",
    "OdometryConfig",
    "RadarConfig",
    "Season",
    "SimulationConfig",
    "SimulationError",
    "StreetKind",
    "TimeOfDay",
    "Weather",
    "WorldConfig",
    "simulate",
    "simulate_drives",
]
