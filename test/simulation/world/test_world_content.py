from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation import Label, StreetKind, WorldConfig
from radcam_depth_ros.simulation.materials.surfaces import Material, Surface, Texture
from radcam_depth_ros.simulation.materials.tiles import TILE, random_tiles
from radcam_depth_ros.simulation.objects.animals import AnimalKind, build_animal
from radcam_depth_ros.simulation.objects.bicycles import build_motorcycle
from radcam_depth_ros.simulation.objects.disguise import Disguise
from radcam_depth_ros.simulation.objects.furniture import guard_rail, wire_fence
from radcam_depth_ros.simulation.objects.mesh import box
from radcam_depth_ros.simulation.settings.style import draw_style
from radcam_depth_ros.simulation.world.path import Path
from radcam_depth_ros.simulation.world.street import Stretch
from radcam_depth_ros.simulation.world.world import World

KINDS = [kind for kind in StreetKind if kind is not StreetKind.ANY]
SEEDS = st.integers(0, 2**31)
STEEL = Material(Surface.METAL, Label.POLE)


@pytest.mark.parametrize("street", KINDS)
def test_every_street_is_whole(street: StreetKind) -> None:
    world = World(1_000_003, WorldConfig(street=street, view_m=100.0), 1.0)
    scene = world.scene_at(0.5)
    assert np.isfinite(scene.faces.corners).all()
    assert set(np.unique(scene.faces.label)) <= set(Label)
    # Rays straight down around the vehicle meet a ground that is about where the vehicle stands: there are no holes.
    pose = world.ego.world_from_base(0.5)
    place = np.random.default_rng(0).uniform([2.5, -4.0], [60.0, 4.0], (800, 2))
    origins = np.column_stack([place, np.full(800, 4.2)]) @ pose.rotation.T + pose.translation
    down = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (800, 1))
    hits = scene.cast(origins.astype(np.float32), down)
    assert (hits.face >= 0).all()
    assert hits.distance_m.max() < 25


@pytest.mark.parametrize(
    ("street", "seed"),
    [
        (StreetKind.JUNCTION, 1_000_000),
        (StreetKind.JUNCTION, 1_000_001),
        (StreetKind.TOWN, 1_000_001),
        (StreetKind.CAR_PARK, 1_000_000),
    ],
)
def test_nothing_drives_through_the_own_vehicle(street: StreetKind, seed: int) -> None:
    world = World(seed, WorldConfig(street=street, view_m=100.0, traffic=2.0, people=3.0), 6.0)
    for time in (0.0, 3.0, 6.0):
        scene, pose = world.scene_at(time), world.ego.world_from_base(time)
        moving = np.flatnonzero(np.abs(scene.velocity).sum(axis=1) > 0)
        corners = (scene.faces.corners[moving].reshape(-1, 3) - pose.translation) @ pose.rotation
        low, high = np.array([-2.0, -0.7, 0.2]), np.array([2.3, 0.7, 1.6])
        assert not ((corners > low) & (corners < high)).all(axis=1).any()


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS, s=st.floats(-90, 790), t=st.floats(-80, 80), steepest=st.floats(0.0, 0.1))
def test_banks_are_no_steeper_than_asked_and_end_beside_the_road(
    seed: int, s: float, t: float, steepest: float
) -> None:
    path = Path(np.random.default_rng(seed), -100, 800, 140.0, steepest)
    low, high = path.camber(s, np.array([t - 0.01, t + 0.01]))
    assert abs(high - low) / 0.02 <= steepest + 1e-6
    assert float(path.camber(s, 0.0)) == 0.0
    if abs(t) >= 60:
        assert float(path.camber(s, t)) == 0.0
    x, y = path.position(s, t)
    lifted = path.tilted(box([0.2, 0.2, 1.0], [0, 0, 0.5], STEEL).moved((float(x), float(y), 0.0)), s, t)
    assert lifted.corners[..., 2].mean() == pytest.approx(0.5 + float(path.camber(s, t)), abs=0.01)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, sign=st.sampled_from([1, -1]), t=st.floats(-20, 20))
def test_what_runs_along_the_road_follows_its_curves(seed: int, sign: int, t: float) -> None:
    rng = np.random.default_rng(seed)
    path = Path(rng, -100, 300, 110.0)
    world = WorldConfig()
    stretch = Stretch(50.0, path, draw_style(rng, world), library=None, rng=rng, people=0.0)  # type: ignore[arg-type]
    stretch.place_along(guard_rail, sign, 50.0, 100.0, t)
    centre = path.position(np.linspace(40, 110, 7001), t)
    points = np.concatenate([part.corners.reshape(-1, 3) for part in stretch.parts])[::7, :2]
    distance = np.linalg.norm(points[:, None] - centre[None], axis=-1).min(axis=1)
    assert distance.max() < 0.2


@pytest.mark.parametrize("kind", list(AnimalKind))
def test_animals_stand_on_the_ground(kind: AnimalKind) -> None:
    corners = build_animal(np.random.default_rng(kind.value), kind).corners
    assert abs(corners[..., 2].min()) < 0.02
    assert 0.4 < corners[..., 2].max() < 2.8


@pytest.mark.parametrize("with_rider", [True, False])
def test_motorcycles_stand_on_the_road(with_rider: bool) -> None:
    vehicle = build_motorcycle(np.random.default_rng(0), with_rider)
    corners = vehicle.mesh.corners.reshape(-1, 3)
    assert abs(corners[:, 2].min()) < 0.02
    assert np.ptp(corners[:, 0]) == pytest.approx(vehicle.length_m, abs=0.3)
    assert (Label.RIDER in vehicle.mesh.label) == with_rider


@settings(max_examples=10, deadline=None)
@given(length=st.floats(0.5, 12), height=st.floats(0.8, 2.5))
def test_a_wire_fence_can_be_seen_through(length: float, height: float) -> None:
    fence = wire_fence(length, height)
    edges = fence.corners[:, 1:] - fence.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    assert area < 0.9 * length * height + 1.0
    assert fence.corners[..., 0].min() > -0.05
    assert fence.corners[..., 0].max() < length + 0.05


def test_random_tiles_are_tiles() -> None:
    tiles = random_tiles(np.random.default_rng(0))
    assert len(tiles) == len(Texture)
    for tile in tiles:
        assert tile.shape == (TILE, TILE, 4)
        assert 0 <= tile.min() <= tile.max() <= 1


def test_a_disguise_keeps_shapes_and_changes_colours() -> None:
    mesh = box([1.0, 1.0, 1.0], [0, 0, 0], STEEL)
    disguise = Disguise(np.random.default_rng(3))
    other = disguise.worn_by(mesh)
    assert other.corners is mesh.corners
    assert np.array_equal(other.colour, disguise.worn_by(mesh).colour)
    assert not np.allclose(other.colour, mesh.colour)
    assert 0 <= other.colour.min() <= other.colour.max() <= 1


@pytest.mark.parametrize(("share", "is_random"), [(0.0, False), (1.0, True)])
def test_the_share_of_random_textures_is_as_asked(share: float, is_random: bool) -> None:
    config = WorldConfig(street=StreetKind.TOWN, view_m=100.0, random_textures=share, traffic=0.0, people=0.0)
    usual = WorldConfig(street=StreetKind.TOWN, view_m=100.0, random_textures=0.0, traffic=0.0, people=0.0)
    world, other = World(5, config, 1.0), World(5, usual, 1.0)
    colours = world.scene_at(0.0).faces.colour, other.scene_at(0.0).faces.colour
    assert colours[0].shape == colours[1].shape
    assert np.allclose(*colours) != is_random
