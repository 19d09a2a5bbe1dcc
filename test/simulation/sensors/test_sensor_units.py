"""What a seed draws of its radars and its LiDAR."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radcam_depth_ros.simulation import ImagingRadarConfig, LidarConfig, LidarUnit, RadarConfig
from radcam_depth_ros.simulation.materials.surfaces import Surface, surface_table
from radcam_depth_ros.simulation.sensors.lidar_unit import draw_beams
from radcam_depth_ros.simulation.sensors.radar_unit import draw_imaging_radar, draw_radar


@given(seed=st.integers(0, 2**31))
def test_a_drawn_radar_lies_in_the_configured_ranges(seed: int) -> None:
    config = ImagingRadarConfig()
    unit = draw_imaging_radar(config, np.random.default_rng(seed))
    assert config.min_points <= unit.max_points <= config.max_points
    assert config.min_threshold_dbsm <= unit.threshold_dbsm <= config.max_threshold_dbsm
    assert config.min_clutter <= unit.clutter <= config.max_clutter * (1 + 1e-9)
    assert config.min_elevation_noise_deg <= np.rad2deg(unit.elevation_noise) <= config.max_elevation_noise_deg + 1e-9
    assert config.min_speed_span_mps <= unit.speed_span_mps <= config.max_speed_span_mps * (1 + 1e-9)
    assert abs(unit.clock_offset_s) <= config.max_clock_offset_s
    assert np.abs(unit.mount_from_radar.translation).max() <= config.max_mounting_error_m
    angle = np.arccos(np.clip((np.trace(unit.mount_from_radar.rotation) - 1) / 2, -1, 1))
    assert angle <= np.deg2rad(config.max_mounting_error_deg) * np.sqrt(3) * 1.001


def test_seeds_differ_and_a_setting_moves_nothing_else() -> None:
    first, other = (draw_radar(RadarConfig(), np.random.default_rng(seed)) for seed in (0, 1))
    assert first.max_points != other.max_points
    changed = draw_radar(RadarConfig(max_range_noise_m=0.2), np.random.default_rng(0))
    assert changed.range_noise_m < first.range_noise_m
    assert changed.clock_offset_s == first.clock_offset_s
    assert changed.clutter == first.clutter


def test_radars_differ_in_what_they_see_most_of() -> None:
    table = surface_table().radar_db
    found = [draw_radar(RadarConfig(), np.random.default_rng(seed)).reflectivity.normal_db for seed in range(20)]
    assert np.std([seen[Surface.FOLIAGE] - seen[Surface.METAL] for seen in found]) > 2
    same = draw_radar(RadarConfig(material_spread_db=0.0), np.random.default_rng(0))
    np.testing.assert_array_equal(same.reflectivity.normal_db, table)


@pytest.mark.parametrize(("unit", "beams"), [("vlp_16", 16), ("hdl_32e", 32), ("vlp_32c", 32), ("hdl_64e", 64)])
def test_a_lidar_has_the_beams_of_its_unit(unit: str, beams: int) -> None:
    found = draw_beams(LidarConfig(unit=LidarUnit(unit)), np.random.default_rng(0))
    assert len(found.elevations_deg) == beams
    assert (np.diff(found.elevations_deg) > 0).all()
    assert -35 < found.elevations_deg[0] < found.elevations_deg[-1] < 25


def test_any_lidar_is_one_of_several() -> None:
    found = [draw_beams(LidarConfig(), np.random.default_rng(seed)) for seed in range(40)]
    assert {len(beams.elevations_deg) for beams in found} == {16, 32, 64}
    short = draw_beams(LidarConfig(max_range_m=30.0), np.random.default_rng(0))
    assert short.max_range_m == 30.0


def test_every_unit_is_drawn_from_frozen_values() -> None:
    unit = draw_radar(RadarConfig(), np.random.default_rng(0))
    with pytest.raises(dataclasses.FrozenInstanceError):
        unit.max_points = 1  # type: ignore[misc]  # frozen, as is tested
