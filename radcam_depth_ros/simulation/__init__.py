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
    Weather,
    WorldConfig,
)
from radcam_depth_ros.simulation.recording import simulate
from radcam_depth_ros.simulation.surfaces import GROUPS, Group, Label

__all__ = [
    "GROUPS",
    "CameraConfig",
    "Group",
    "ImagingRadarConfig",
    "Label",
    "LidarConfig",
    "OdometryConfig",
    "RadarConfig",
    "Season",
    "SimulationConfig",
    "SimulationError",
    "StreetKind",
    "Weather",
    "WorldConfig",
    "simulate",
]
