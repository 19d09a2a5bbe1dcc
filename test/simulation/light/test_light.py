from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation import (
    CameraConfig,
    ImagingRadarConfig,
    LidarConfig,
    RadarConfig,
    TimeOfDay,
    Weather,
    WorldConfig,
)
from radcam_depth_ros.simulation.light.lamps import Lamps, shining_lamps
from radcam_depth_ros.simulation.light.light import Light, draw_light
from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import box, join, quads
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.sensors.lens import CameraOptics
from radcam_depth_ros.simulation.sensors.optics import motion_field, smeared
from radcam_depth_ros.simulation.sensors.rig import draw_rig

SEEDS = st.integers(0, 2**31)
WEATHERS = [weather for weather in Weather if weather is not Weather.ANY]
TIMES = [time for time in TimeOfDay if time is not TimeOfDay.ANY]
CAMERA = CameraModel(80, 48, 63.0, 63.0, 39.5, 23.5)
# Looks along the world's x axis, 1.5 m above the ground.
AHEAD = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.0, 0.0, 1.5]))

SENSORS = (RadarConfig(), ImagingRadarConfig(), LidarConfig())


def light_of(seed: int, weather: Weather = Weather.ANY, time: TimeOfDay = TimeOfDay.ANY, odd: float = 0.0) -> Light:
    return draw_light(np.random.default_rng(seed), WorldConfig(weather=weather, time_of_day=time, random_light=odd))


@pytest.mark.parametrize("weather", WEATHERS)
@pytest.mark.parametrize("time", TIMES)
def test_light_is_of_the_kind_that_was_asked(weather: Weather, time: TimeOfDay) -> None:
    lights = [light_of(seed, weather, time) for seed in range(20)]
    assert {(light.weather, light.time_of_day, light.random) for light in lights} == {(weather, time, False)}
    shines = [max(light.sun) > 0 for light in lights]
    assert any(shines) == (weather in (Weather.SUNNY, Weather.CLOUDY) and time is not TimeOfDay.NIGHT)
    assert all(light.beam_candela > 0 for light in lights) == (time is not TimeOfDay.DAY)
    assert all(light.rain > 0 for light in lights) == (weather is Weather.RAIN)
    brightest = {TimeOfDay.DAY: (0.2, 2.0), TimeOfDay.DUSK: (1e-3, 0.5), TimeOfDay.NIGHT: (1e-6, 2e-3)}[time]
    assert all(brightest[0] < max(light.sky) < brightest[1] for light in lights)


def test_any_light_is_every_kind_of_light() -> None:
    lights = [light_of(seed, odd=0.15) for seed in range(300)]
    assert {light.weather for light in lights} == set(WEATHERS)
    assert {light.time_of_day for light in lights} == set(TIMES)
    assert 20 < sum(light.random for light in lights) < 80


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, odd=st.sampled_from([0.0, 1.0]))
def test_light_has_sound_numbers(seed: int, odd: float) -> None:
    light = light_of(seed, odd=odd)
    assert np.linalg.norm(light.sun_direction) == pytest.approx(1.0)
    assert light.sun_direction[2] > 0
    for colour in (light.sun, light.sky, light.zenith, light.horizon, light.glow, light.haze, light.street_lamps):
        assert np.isfinite(colour).all()
        assert min(colour) >= 0
    assert light.haze_m > 10


def test_a_street_lamp_lights_what_is_near_and_turned_to_it() -> None:
    lamp = Lamps(*(np.array([row], np.float32) for row in ([0, 0, 6], [0, 0, 0], [0.2, 0.2, 0.2])))
    point = np.array([[0, 0, 0], [10, 0, 0], [60, 0, 0], [0, 0, 0]], np.float32)
    up = np.array([0, 0, 1], np.float32)
    below, aside, far, turned = lamp.light(point, np.stack([up, up, up, -up]))[:, 0]
    assert below > 3 * aside > 0
    assert below == pytest.approx(0.2 / 36, rel=0.2)
    assert far == turned == 0


def test_at_night_lamps_on_vehicles_and_posts_are_found() -> None:
    glass, lantern = Material(Surface.LAMP, Label.CAR, (0.8, 0.8, 0.75)), Material(Surface.LAMP, Label.POLE)
    ground = quads([[(-90, -90, 0), (90, -90, 0), (90, 90, 0), (-90, 90, 0)]], Material(Surface.ASPHALT, Label.ROAD))
    posts = [box([0.2, 0.5, 0.06], [x, 4.0, 7.0], lantern) for x in (10.0, 30.0)]
    scene = Scene(join([ground, *posts]))
    car = join([box([0.1, 0.3, 0.1], [40.0, y, 0.6], glass) for y in (-0.6, 0.6)])
    scene.set_movers([(car, np.array([-12.0, 0.0, 0.0]))])
    lit = next(
        light for light in (light_of(seed, time=TimeOfDay.NIGHT) for seed in range(20)) if max(light.street_lamps)
    )
    lamps = shining_lamps(scene, lit, AHEAD)
    assert sorted(lamps.place[~lamps.aim.any(axis=1), 0]) == pytest.approx([10.0, 30.0], abs=0.01)
    assert sorted(lamps.aim[lamps.aim.any(axis=1), 0]) == pytest.approx([-1.0, -1.0, 1.0])
    assert len(shining_lamps(scene, light_of(0, time=TimeOfDay.DAY), AHEAD).place) == 0


@settings(max_examples=25, deadline=None)
@given(depth=st.floats(3, 80), speed=st.floats(-20, 20), turn=st.floats(-0.3, 0.3))
def test_motion_is_the_change_of_the_projection(depth: float, speed: float, turn: float) -> None:
    velocity, rate = np.array([speed, 0.5, 0.0]), np.array([0.0, 0.0, turn])
    flow = motion_field(
        CAMERA, AHEAD, np.full((48, 80), depth, np.float32), np.zeros((48, 80, 3), np.float32), velocity, rate
    )
    row, column, step = 40, 60, 1e-4
    ray = np.array([(column - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy, 1.0])
    seen = AHEAD.rotation @ (ray * depth)
    cosine, sine = np.cos(turn * step), np.sin(turn * step)
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ AHEAD.rotation
    later = turned.T @ (seen - velocity * step)
    moved = np.array(
        [later[0] / later[2] * CAMERA.fx + CAMERA.cx - column, later[1] / later[2] * CAMERA.fy + CAMERA.cy - row]
    )
    assert flow[row, column] == pytest.approx(moved / step, abs=0.2 + 0.02 * np.abs(moved / step).max())


def test_the_sky_and_what_drives_along_stay_sharp() -> None:
    depth = np.full((48, 80), np.inf, np.float32)
    depth[24:] = 10.0
    velocity = np.zeros((48, 80, 3), np.float32)
    velocity[24:, :40, 0] = 15.0
    flow = motion_field(CAMERA, AHEAD, depth, velocity, np.array([15.0, 0, 0]), np.zeros(3))
    assert not flow[:24].any()
    assert not flow[24:, :40].any()
    assert np.abs(flow[24:, 60:]).max() > 10
    picture = np.random.default_rng(0).random((48, 80, 3)).astype(np.float32)
    blurred = smeared(picture, flow * np.float32(0.1))
    assert np.allclose(blurred[:24], picture[:24])
    assert blurred[30:, 60:].std() < picture[30:, 60:].std()


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, rain=st.sampled_from([0.0, 1.0]), odd=st.booleans())
def test_any_lens_gives_a_picture(seed: int, rain: float, odd: bool) -> None:
    rng = np.random.default_rng(seed)
    radiance = rng.random((48, 80, 3)).astype(np.float32) * np.linspace(0.02, 2, 80, dtype=np.float32)[:, None]
    radiance[10, 10] = 300.0
    picture = CameraOptics(rng, 80, 48, rain, odd).develop(radiance, rng, np.full((48, 80, 2), 200.0, np.float32))
    assert picture.shape == (48, 80, 3)
    assert picture.std() > 3


def test_each_seed_draws_a_size_between_the_least_and_the_most() -> None:
    config = CameraConfig(width=1000, height=500, min_width=500, min_height=200)
    cameras = [draw_rig(seed, config, *SENSORS).camera for seed in range(60)]
    assert min(camera.width for camera in cameras) < 560
    assert max(camera.width for camera in cameras) > 940
    assert all(500 <= camera.width <= 1000 and 200 <= camera.height <= 500 for camera in cameras)
    assert {camera.fx for camera in cameras} == {630.0}
    assert {draw_rig(seed, CameraConfig(), *SENSORS).camera.width for seed in range(5)} == {800}
