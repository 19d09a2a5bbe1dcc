"""Drives of which it is known where the sensors are."""

from __future__ import annotations

from pathlib import Path

import pytest
from calibration_drive import PostsDrive, write_posts_drive

from radcam_depth_ros import simulation
from radcam_depth_ros.calibration.recording import Recording, read_recording
from radcam_depth_ros.drive import DriveSettings

FRAMES = 4


@pytest.fixture(scope="session")
def posts_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Past posts, with braking and turns, LiDAR and odometry."""
    return write_posts_drive(tmp_path_factory.mktemp("posts") / "drive.mcap", PostsDrive(seconds=6.0))


@pytest.fixture(scope="session")
def posts(posts_bag: Path) -> Recording:
    """What is read of it."""
    return read_recording(posts_bag, DriveSettings(), FRAMES, lambda done, total: None)


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Key frames of a simulated street: a 4D radar and a LiDAR, no motion."""
    config = simulation.SimulationConfig(
        world=simulation.WorldConfig(street=simulation.StreetKind.RURAL, traffic=0.0, people=0.0, view_m=100.0),
        camera=simulation.CameraConfig(
            width=96,
            height=64,
            min_focal_length_px=76.0,
            max_focal_length_px=76.0,
            rate_hz=2.0,
            depth=False,
            classes=False,
            edge_samples=0,
        ),
        radar=simulation.RadarConfig(enabled=False),
        imaging_radar=simulation.ImagingRadarConfig(max_points=1500),
        lidar=simulation.LidarConfig(unit=simulation.LidarUnit.VLP_16, columns=300),
        key_frames=True,
    )
    path = tmp_path_factory.mktemp("simulated") / "drive.mcap"
    simulation.simulate(config, 21, 3, path)
    return read_recording(path, DriveSettings(max_lidar_offset_s=0.1), 3, lambda done, total: None)
