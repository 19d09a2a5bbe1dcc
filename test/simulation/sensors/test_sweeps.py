from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation import ImagingRadarConfig, LidarConfig, LidarUnit, RadarConfig
from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join, quads
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.sensors.lidar import sweep_lidar
from radcam_depth_ros.simulation.sensors.lidar_unit import draw_beams
from radcam_depth_ros.simulation.sensors.radar import sweep_imaging_radar, sweep_radar
from radcam_depth_ros.simulation.sensors.radar_unit import ImagingRadarUnit, RadarUnit, draw_imaging_radar, draw_radar

STEEL = Material(Surface.BODYWORK, Label.CAR, (0.5, 0.5, 0.5))
ROAD = Material(Surface.ASPHALT, Label.ROAD, (0.2, 0.2, 0.2))
QUIET = {"min_clutter": 0.0, "max_clutter": 0.0, "max_ghosts": 0.0, "max_mirror": 0.0, "interference": 0.0}


def radar(seed: int = 0, **changes: Any) -> RadarUnit:
    """A radar of a seed; by default without false echoes."""
    return draw_radar(RadarConfig(**{**QUIET, **changes}), np.random.default_rng(seed))


def imaging_radar(seed: int = 0, **changes: Any) -> ImagingRadarUnit:
    """The same with elevation."""
    return draw_imaging_radar(ImagingRadarConfig(**{**QUIET, **changes}), np.random.default_rng(seed))


def floor() -> Mesh:
    return quads([[(-200, -200, 0), (200, -200, 0), (200, 200, 0), (-200, 200, 0)]], ROAD)


def wall(distance: float) -> Mesh:
    return box([0.2, 20.0, 4.0], [distance + 0.1, 0, 2.0], STEEL)


def sensor() -> RigidTransform:
    return RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.5]))


@settings(max_examples=25, deadline=None)
@given(distance=st.floats(4, 90), seed=st.integers(0, 2**31))
def test_lidar_measures_a_wall(distance: float, seed: int) -> None:
    config = LidarConfig(unit=LidarUnit.VLP_16, beams=8, columns=256, missed=0.0)
    rng = np.random.default_rng(seed)
    turn = sweep_lidar(Scene(wall(distance)), sensor(), config, draw_beams(config, rng), 0.0, rng)
    assert turn["x"].dtype == np.float32
    # The nearest face of the wall, and its ends where it is close.
    middle = np.abs(turn["y"]) < 9.5
    assert np.abs(turn["x"][middle] - distance).max() < 0.15


@pytest.mark.parametrize("target_speed", [-12.0, 0.0, 7.0])
@pytest.mark.parametrize("own_speed", [0.0, 15.0])
def test_doppler_is_the_relative_motion(target_speed: float, own_speed: float) -> None:
    scene = Scene(floor())
    scene.set_movers([(wall(30.0), np.array([target_speed, 0.0, 0.0]))])
    velocity = np.array([own_speed, 0.0, 0.0])
    rng = np.random.default_rng(0)
    sweep = sweep_radar(scene, sensor(), velocity, radar(), rng)
    far = (sweep["x"] > 25) & (np.abs(sweep["y"]) < 8)
    assert far.sum() >= 5
    cosine = sweep["x"][far] / np.hypot(sweep["x"][far], sweep["y"][far])
    radial = np.hypot(sweep["vx"][far], sweep["vy"][far]) * np.sign(sweep["vx"][far])
    assert radial == pytest.approx((target_speed - own_speed) * cosine, abs=0.6)
    compensated = np.hypot(sweep["vx_comp"][far], sweep["vy_comp"][far]) * np.sign(sweep["vx_comp"][far])
    assert compensated == pytest.approx(target_speed * cosine, abs=0.6)
    expected = {-12.0: 2, 0.0: 1, 7.0: 0}[target_speed]
    assert (sweep["dyn_prop"][far] == expected).mean() > 0.9
    imaging = sweep_imaging_radar(scene, sensor(), velocity, imaging_radar(min_speed_span_mps=160.0), rng)
    near_axis = (imaging["x"] > 25) & (np.abs(imaging["y"]) < 3)
    assert np.median(imaging["velocity"][near_axis]) == pytest.approx(target_speed - own_speed, abs=0.3)


def test_a_radar_sees_below_the_vehicle_in_front() -> None:
    hidden = box([4.5, 1.8, 1.4], [40.0, 0, 0.9], STEEL)
    front = box([4.5, 2.6, 2.0], [12.0, 0, 1.5], STEEL)
    scene = Scene(join([floor(), front, hidden]))
    found = [sweep_radar(scene, sensor(), np.zeros(3), radar(seed), np.random.default_rng(seed)) for seed in range(8)]
    assert any(((sweep["x"] > 36) & (sweep["x"] < 40)).any() for sweep in found)


def test_radar_cross_sections_follow_size() -> None:
    def strongest(target: Mesh) -> float:
        sweep = sweep_radar(
            Scene(target), sensor(), np.zeros(3), radar(max_threshold_dbsm=-10.0), np.random.default_rng(0)
        )
        return float(sweep["rcs"].max(initial=-99.0))

    person = ball(0.4, (20.0, 0.0, 0.9), Material(Surface.CLOTH, Label.PERSON), (1, 1, 2))
    assert strongest(person) + 5 < strongest(box([4.0, 1.8, 1.4], [22.0, 0, 0.9], STEEL))


def test_a_sweep_that_meets_nothing_is_empty() -> None:
    scene = Scene(quads([[(-5, -1, 0), (-4, -1, 0), (-4, 1, 0), (-5, 1, 0)]], STEEL))
    rng = np.random.default_rng(0)
    sweep = sweep_radar(scene, sensor(), np.zeros(3), radar(), rng)
    columns: list[npt.NDArray[np.generic]] = [*sweep.values()]
    columns += sweep_imaging_radar(scene, sensor(), np.zeros(3), imaging_radar(), rng).values()
    assert {len(column) for column in columns} == {0}


def test_a_wall_along_the_road_shows_a_mirror_image_behind_it() -> None:
    rail = box([60.0, 0.2, 4.0], [30.0, -4.1, 2.0], Material(Surface.METAL, Label.FENCE))
    lorry = box([0.2, 2.4, 3.0], [40.1, 2.0, 1.5], STEEL)
    scene = Scene(join([rail, lorry]))

    def behind_the_wall(mirror: float) -> int:
        unit = replace(imaging_radar(max_threshold_dbsm=-28.0, max_elevation_noise_deg=0.4), mirror=mirror)
        sweep = sweep_imaging_radar(scene, sensor(), np.zeros(3), unit, np.random.default_rng(0))
        # The lorry is at y = 2 and the wall's face at y = -4: its image is at y = -10.
        return int(((np.abs(sweep["x"] - 40) < 1.5) & (np.abs(sweep["y"] + 10) < 2.0)).sum())

    assert behind_the_wall(0.0) == 0
    assert behind_the_wall(0.2) > 0


def test_speeds_are_folded_into_the_span_that_a_radar_tells_apart() -> None:
    scene = Scene(floor())
    scene.set_movers([(wall(30.0), np.array([-9.0, 0.0, 0.0]))])
    unit = imaging_radar(min_speed_span_mps=10.0, max_speed_span_mps=10.0)
    sweep = sweep_imaging_radar(scene, sensor(), np.zeros(3), unit, np.random.default_rng(0))
    assert np.abs(sweep["velocity"]).max() <= 5.0
    ahead = (sweep["x"] > 25) & (np.abs(sweep["y"]) < 3)
    assert np.median(sweep["velocity"][ahead]) == pytest.approx(1.0, abs=0.3)


def test_elevations_are_as_noisy_as_the_unit() -> None:
    scene = Scene(wall(30.0))
    spread = []
    for noise_deg in (0.4, 6.0):
        unit = imaging_radar(min_elevation_noise_deg=noise_deg, max_elevation_noise_deg=noise_deg)
        sweep = sweep_imaging_radar(scene, sensor(), np.zeros(3), unit, np.random.default_rng(0))
        angle = np.rad2deg(np.arctan2(sweep["z"], np.hypot(sweep["x"], sweep["y"])))
        spread.append(float(np.std(angle)))
    assert spread[1] > spread[0] + 1


def test_many_returns_show_where_a_car_is() -> None:
    car = box([4.4, 1.8, 1.4], [22.2, 0.0, 0.9], STEEL)
    unit = imaging_radar(max_threshold_dbsm=-28.0, max_elevation_noise_deg=0.4, max_azimuth_noise_deg=0.2)
    sweep = sweep_imaging_radar(Scene(join([floor(), car])), sensor(), np.zeros(3), unit, np.random.default_rng(0))
    on_car = (np.abs(sweep["x"] - 22) < 3) & (np.abs(sweep["y"]) < 1.5)
    assert on_car.sum() >= 5
    assert np.ptp(sweep["y"][on_car]) > 1.0


def test_a_lidar_loses_wet_roads_and_dark_things_far_away() -> None:
    config = LidarConfig(unit=LidarUnit.HDL_32E, missed=0.0)
    beams, roof = draw_beams(config, np.random.default_rng(0)), RigidTransform(np.eye(3), np.array([0.0, 0.0, 2.0]))

    def returns(mesh: Mesh, wetness: float) -> int:
        turn = sweep_lidar(Scene(mesh), roof, config, beams, wetness, np.random.default_rng(0))
        return int((np.hypot(turn["x"], turn["y"]) > 20).sum())

    assert returns(floor(), 1.0) < 0.5 * returns(floor(), 0.0)
    black, white = (
        box([0.2, 20.0, 8.0], [80.1, 0.0, 2.0], material) for material in (Material(Surface.RUBBER, Label.CAR), STEEL)
    )
    assert returns(black, 0.0) < 0.5 * returns(white, 0.0)
