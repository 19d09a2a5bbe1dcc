from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation import (
    CameraConfig,
    ImagingRadarConfig,
    LidarConfig,
    RadarConfig,
    StreetKind,
    WorldConfig,
)
from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.materials.textures import TextureAtlas
from radcam_depth_ros.simulation.materials.tiles import fractal
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join, prism, tube
from radcam_depth_ros.simulation.objects.plants import PlantKind, build_plant
from radcam_depth_ros.simulation.objects.vehicle_parts import VehicleKind
from radcam_depth_ros.simulation.objects.vehicles import build_vehicle, with_lamps_off
from radcam_depth_ros.simulation.sensors.lens import CameraOptics
from radcam_depth_ros.simulation.sensors.rig import CAMERA, draw_rig
from radcam_depth_ros.simulation.settings.style import draw_style
from radcam_depth_ros.simulation.world.ego import EgoDrive
from radcam_depth_ros.simulation.world.path import Path
from radcam_depth_ros.simulation.world.relief import Relief
from radcam_depth_ros.simulation.world.world import World

PLAIN = Material(Surface.METAL, Label.POLE)
SEEDS = st.integers(0, 2**31)

SENSORS = (RadarConfig(), ImagingRadarConfig(), LidarConfig())


def is_sound(mesh: Mesh) -> bool:
    lengths = np.linalg.norm(mesh.normals, axis=-1)
    return bool(np.isfinite(mesh.corners).all() and np.isfinite(mesh.uv).all() and np.allclose(lengths, 1, atol=1e-3))


@pytest.mark.parametrize(
    "mesh",
    [
        box([2.0, 3.0, 4.0], [0, 0, 2.0], PLAIN),
        tube(0.2, 4.0, PLAIN),
        ball(1.0, (0, 0, 1), PLAIN),
        prism([(-1, 0), (1, 0), (0.5, 1), (-0.5, 1)], 2.0, PLAIN, 1.0, bulge=0.1),
        join([]),
    ],
)
def test_shapes_are_sound(mesh: Mesh) -> None:
    assert is_sound(mesh)
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    assert (np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 0).all()


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-500, 500), y=st.floats(-500, 500), yaw=st.floats(-4, 4))
def test_moving_keeps_shape(x: float, y: float, yaw: float) -> None:
    before = box([2.0, 3.0, 4.0], [0, 0, 2.0], PLAIN)
    after = before.moved((x, y, 0.0), yaw)
    sides = [np.linalg.norm(np.diff(mesh.corners, axis=1), axis=-1) for mesh in (before, after)]
    assert np.allclose(*sides, atol=1e-3)
    assert np.allclose(after.corners.mean(axis=(0, 1)), (x, y, 2.0), atol=1e-3)
    assert is_sound(after)


@pytest.mark.parametrize("kind", list(VehicleKind))
def test_vehicles_stand_on_the_road_and_fit_their_size(kind: VehicleKind) -> None:
    vehicle = build_vehicle(np.random.default_rng(kind.value), kind)
    corners = vehicle.mesh.corners.reshape(-1, 3)
    assert is_sound(vehicle.mesh)
    assert abs(corners[:, 2].min()) < 0.02
    assert np.ptp(corners[:, 0]) == pytest.approx(vehicle.length_m, abs=0.15)
    assert np.ptp(corners[:, 1]) <= vehicle.width_m + 0.5
    assert set(np.unique(vehicle.mesh.label)) <= {Label.CAR, Label.TRUCK, Label.BUS}
    assert Surface.LAMP not in with_lamps_off(vehicle.mesh).surface


@pytest.mark.parametrize("kind", list(PlantKind))
def test_plants_are_sound_and_coarser_far_away(kind: PlantKind) -> None:
    plant = build_plant(np.random.default_rng(1), kind, (0.1, 0.2, 0.05))
    assert is_sound(plant.near)
    assert is_sound(plant.far)
    assert len(plant.far) < len(plant.near)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, s=st.floats(-150, 900), t=st.floats(-10, 10))
def test_the_road_is_measured_in_metres(seed: int, s: float, t: float) -> None:
    path = Path(np.random.default_rng(seed), -100, 800, 140.0)
    here, there = path.position([s, s + 0.5], [0.0, 0.0])
    assert np.linalg.norm(there - here) == pytest.approx(0.5, abs=0.01)
    assert np.linalg.norm(path.position(s, t) - path.position(s, 0.0)) == pytest.approx(abs(t), abs=1e-6)
    assert np.allclose(path.position(0.0, 0.0), 0.0)


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, time=st.floats(0, 60))
def test_the_own_velocity_is_the_change_of_its_pose(seed: int, time: float) -> None:
    rng = np.random.default_rng(seed)
    style = draw_style(rng, WorldConfig())
    relief = Relief(rng, 0.08)
    ego = EgoDrive(rng, style, Path(rng, -100, 3000, style.min_radius_m), relief)
    step = 0.05
    moved = ego.world_from_base(time + step).translation - ego.world_from_base(time - step).translation
    motion = ego.motion(time)
    assert np.allclose(motion.velocity, moved / (2 * step), atol=0.25)
    assert np.diff(ego.s([time, time + 1.0]))[0] >= 0
    assert np.allclose(motion.velocity_at(np.zeros(3)), motion.velocity)
    x, y, z = motion.world_from_base.translation
    assert z == pytest.approx(float(relief.height(x, y)), abs=1e-6)
    # The vehicle stands on the slope: its own plane is the ground's, but for a little pitch and roll of its body.
    rise = np.array([*relief.slope(x, y), -1.0])
    assert abs(motion.world_from_base.rotation[:, 2] @ rise) / np.linalg.norm(rise) > 0.9999


def test_a_mounting_does_not_depend_on_the_image() -> None:
    small = draw_rig(4, CameraConfig(width=160, height=96), *SENSORS)
    large = draw_rig(4, CameraConfig(min_focal_length_px=900, max_focal_length_px=1800), *SENSORS)
    for frame, pose in small.base_from_sensor.items():
        assert np.allclose(pose.translation, large.base_from_sensor[frame].translation)
    assert 900 <= large.camera.fx <= 1800
    assert 1.2 <= small.footprint_from(CAMERA).translation[2] <= 2.0


def test_noise_tiles_and_is_normed() -> None:
    noise = fractal(np.random.default_rng(0), 64, 1.5)
    assert abs(noise.mean()) < 1e-5
    assert noise.std() == pytest.approx(1.0, abs=1e-4)
    inner = np.abs(np.diff(noise, axis=1)).mean()
    assert np.abs(noise[:, 0] - noise[:, -1]).mean() < 2 * inner


def test_the_atlas_gives_the_tiles_mean_from_far_away() -> None:
    atlas = TextureAtlas(np.random.default_rng(0))
    texture = np.repeat(np.arange(len(Texture), dtype=np.uint8), 400)
    uv = np.random.default_rng(1).uniform(-3, 3, (len(texture), 2)).astype(np.float32)
    far, gloss = atlas.sample(texture, uv, np.full(len(texture), 1.0, np.float32))
    near, _ = atlas.sample(texture, uv, np.full(len(texture), 1e-3, np.float32))
    means = [colour.reshape(len(Texture), -1, 3).mean(axis=1) for colour in (near, far)]
    assert means[0] == pytest.approx(means[1], abs=0.15)
    assert far[texture == Texture.PLAIN] == pytest.approx(1.0, abs=0.01)
    assert gloss.min() >= 0
    assert gloss.max() <= 1


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_exposure_brings_any_light_into_the_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radiance = (rng.random((48, 64, 3)) * 10 ** rng.uniform(-3, 3)).astype(np.float32)
    picture = CameraOptics(rng, 64, 48).develop(radiance, rng)
    assert picture.shape == (48, 64, 3)
    assert 15 < picture.mean() < 250


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, x=st.floats(-2000, 2000), y=st.floats(-2000, 2000), steepest=st.floats(0, 0.2))
def test_no_hill_is_steeper_than_asked(seed: int, x: float, y: float, steepest: float) -> None:
    relief = Relief(np.random.default_rng(seed), steepest)
    assert np.linalg.norm(relief.slope(x, y)) <= steepest + 1e-6
    assert float(relief.height(0.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    lifted = relief.lifted(box([1.0, 1.0, 1.0], [x, y, 0.5], PLAIN))
    assert lifted.corners[..., 2].mean() == pytest.approx(0.5 + float(relief.height(x, y)), abs=0.01)


def test_hills_are_common_and_flat_land_too() -> None:
    slopes = [np.linalg.norm(Relief(np.random.default_rng(seed), 0.05).slope(50.0, 20.0)) for seed in range(60)]
    assert 10 < np.count_nonzero(slopes) < 50
    assert max(slopes) > 0.01


@pytest.mark.parametrize("street", [StreetKind.RESIDENTIAL, StreetKind.HIGHWAY])
def test_a_scene_does_not_depend_on_what_was_asked_before(street: StreetKind) -> None:
    config = WorldConfig(street=street, view_m=100.0, traffic=2.0)
    once, twice = World(7, config, 30.0), World(7, config, 30.0)
    for time in (0.0, 29.0):
        once.scene_at(time)
    rays = np.random.default_rng(0).standard_normal((500, 3)).astype(np.float32)
    origins = np.tile(np.array([*once.ego.world_from_base(1.0).translation[:2], 1.5], np.float32), (500, 1))
    first, second = (world.scene_at(1.0).cast(origins, rays) for world in (once, twice))
    assert np.array_equal(first.distance_m, second.distance_m)
    assert np.array_equal(first.face, second.face)
    assert (first.face >= 0).mean() > 0.4


def test_looking_nothing_up_gives_nothing() -> None:
    none = np.zeros(0, np.float32)
    colour, gloss = TextureAtlas(np.random.default_rng(0)).sample(np.zeros(0, np.uint8), none.reshape(0, 2), none)
    assert (colour.shape, gloss.shape) == ((0, 3), (0,))
