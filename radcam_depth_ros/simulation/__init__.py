"""Simulated drives: a street, a vehicle with camera, radars and LiDAR, and the bag of what they measure."""

from radcam_depth_ros.simulation.configuration import (
    CameraConfig,
    ImagingRadarConfig,
    LidarConfig,
    OdometryConfig,
    RadarConfig,
    Season,
    SimulationConfig,
    SimulationError,
    StreetKind,
    TimeOfDay,
    Weather,
    WorldConfig,
)
from radcam_depth_ros.simulation.recording import simulate

__all__ = [
    "CameraConfig",
    "ImagingRadarConfig",
    "LidarConfig",
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
]
