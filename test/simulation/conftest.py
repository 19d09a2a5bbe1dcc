"""A small drive, simulated once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from radcam_depth_ros import simulation
from radcam_depth_ros.bags import BagReader

SMALL_CAMERA = simulation.CameraConfig(width=160, height=96, min_focal_length_px=126.0, max_focal_length_px=126.0)
"""The default camera, five times smaller."""

STILL = simulation.WorldConfig(
    street=simulation.StreetKind.TOWN, speed=0.0, traffic=0.0, people=0.0, max_slope=0.0, view_m=150.0
)
"""Nothing moves, so that sensors that measure at different times see the same."""

EXACT_RADAR = simulation.ImagingRadarConfig(
    max_elevation_noise_deg=0.6,
    max_azimuth_noise_deg=0.3,
    max_clutter=15.0,
    max_ghosts=0.03,
    max_mirror=0.0,
    max_road_mirror=0.02,
    max_mounting_error_deg=0.0,
    max_mounting_error_m=0.0,
)
"""A 4D radar that is as good as they get, so that its points can be compared with the exact depth."""

Recorder = Callable[..., Path]


@dataclass(frozen=True)
class Recording:
    """The messages of a bag by topic, in their order."""

    messages: dict[str, list[Any]]

    @classmethod
    def read(cls, path: Path) -> Recording:
        with BagReader(path) as reader:
            found: dict[str, list[Any]] = {}
            for message in reader.messages():
                found.setdefault(message.topic, []).append(message.message)
            return cls(found)


@pytest.fixture(scope="session")
def record(tmp_path_factory: pytest.TempPathFactory) -> Recorder:
    """Simulates a small drive into a fresh folder."""

    def simulate(config: simulation.SimulationConfig, seed: int = 3, frames: int = 2) -> Path:
        path = tmp_path_factory.mktemp("drive") / "drive.mcap"
        simulation.simulate(config, seed, frames, path)
        return path

    return simulate


@pytest.fixture(scope="session")
def read() -> Callable[[Path], Recording]:
    """Reads a bag."""
    return Recording.read


@pytest.fixture(scope="session")
def still_drive(record: Recorder, read: Callable[[Path], Recording]) -> Recording:
    """Two images of a street where nothing moves."""
    return read(record(simulation.SimulationConfig(world=STILL, camera=SMALL_CAMERA, imaging_radar=EXACT_RADAR)))
