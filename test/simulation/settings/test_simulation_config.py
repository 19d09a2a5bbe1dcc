from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from radcam_depth_ros import configuration
from radcam_depth_ros.simulation import CameraConfig, SimulationConfig, SimulationError, StreetKind, simulate

SHIPPED = Path(__file__).parents[3] / "config" / "simulation.yaml"


def test_the_shipped_file_holds_the_defaults() -> None:
    assert configuration.load(SimulationConfig, SHIPPED) == SimulationConfig()


def test_the_shipped_file_names_every_setting() -> None:
    assert yaml.safe_load(SHIPPED.read_text(encoding="utf-8")) == configuration.as_mapping(SimulationConfig())


def test_every_setting_of_the_shipped_file_is_explained() -> None:
    lines = SHIPPED.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if ":" in line and "#" not in line] == []


def test_the_settings_of_drives_to_train_on_are_read() -> None:
    config = configuration.load(SimulationConfig, SHIPPED.with_name("training_drives.yaml"))
    assert config.key_frames
    assert not config.lidar.enabled


def test_part_of_the_settings_is_enough() -> None:
    config = configuration.build(SimulationConfig, {"world": {"street": "rural"}, "camera": {"rate_hz": 1}})
    assert config.world.street is StreetKind.RURAL
    assert config.camera.rate_hz == 1.0
    assert config.radar == SimulationConfig().radar


@pytest.mark.parametrize(
    ("mapping", "named"),
    [
        ({"camera": {"width": 2}}, "camera.width"),
        ({"camera": {"min_height_m": 2.0, "max_height_m": 1.0}}, "max_height_m"),
        ({"camera": {"min_jpeg_quality": 0}}, "min_jpeg_quality"),
        ({"camera": {"rate_hz": 0}}, "rate_hz"),
        ({"camera": {"edge_samples": 9}}, "edge_samples"),
        ({"camera": {"min_width": 900}}, "camera.width, which is 800"),
        ({"camera": {"min_height": 8}}, "min_height"),
        ({"world": {"random_light": 1.5}}, "random_light"),
        ({"world": {"time_of_day": "noon"}}, "time_of_day"),
        ({"world": {"traffic": -1}}, "traffic"),
        ({"world": {"view_m": 5}}, "view_m"),
        ({"world": {"street": "canal"}}, "street"),
        ({"radar": {"max_missed": 1.5}}, "max_missed"),
        ({"radar": {"min_points": 200}}, "max_points"),
        ({"radar": {"interference": -0.1}}, "radar.interference"),
        ({"imaging_radar": {"min_elevation_noise_deg": 9}}, "max_elevation_noise_deg"),
        ({"imaging_radar": {"max_spread": -1}}, "max_spread"),
        ({"imaging_radar": {"max_intensity_offset_db": -1}}, "max_intensity_offset_db"),
        ({"imaging_radar": {"max_range_m": 1}}, "max_range_m"),
        ({"lidar": {"beams": 0}}, "beams"),
        ({"lidar": {"unit": "vlp_17"}}, "unit"),
        ({"lidar": {"min_height_m": 3.0}}, "max_height_m"),
        ({"odometry": {"rate_hz": 5000}}, "1000 Hz"),
        ({"start_s": 0}, "start_s"),
        ({"camera": {"widht": 2}}, "width"),
    ],
)
def test_values_that_cannot_be_are_refused_by_name(mapping: dict[str, object], named: str) -> None:
    with pytest.raises((SimulationError, configuration.ConfigurationError), match=named):
        configuration.build(SimulationConfig, mapping)


@pytest.mark.parametrize(("seed", "frames"), [(-1, 1), (2**63, 1), (0, 0)])
def test_seeds_and_frames_out_of_range_are_refused(seed: int, frames: int, tmp_path: Path) -> None:
    with pytest.raises(SimulationError):
        simulate(SimulationConfig(), seed, frames, tmp_path / "drive")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("height_m", [0.9, 2.6, -1.0])
def test_a_usual_height_lies_between_the_least_and_the_most(height_m: float) -> None:
    with pytest.raises(SimulationError, match=r"usual_height_m must be 0 .* or lie between"):
        CameraConfig(min_height_m=1.0, usual_height_m=height_m, max_height_m=2.5)
