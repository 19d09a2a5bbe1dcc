from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.simulation import StreetKind, WorldConfig
from radcam_depth_ros.simulation.materials.surfaces import Label
from radcam_depth_ros.simulation.world.world import World

KINDS = [kind for kind in StreetKind if kind is not StreetKind.ANY]


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


@pytest.mark.parametrize(("share", "is_random"), [(0.0, False), (1.0, True)])
def test_the_share_of_random_textures_is_as_asked(share: float, is_random: bool) -> None:
    config = WorldConfig(street=StreetKind.TOWN, view_m=100.0, random_textures=share, traffic=0.0, people=0.0)
    usual = WorldConfig(street=StreetKind.TOWN, view_m=100.0, random_textures=0.0, traffic=0.0, people=0.0)
    world, other = World(5, config, 1.0), World(5, usual, 1.0)
    colours = world.scene_at(0.0).faces.colour, other.scene_at(0.0).faces.colour
    assert colours[0].shape == colours[1].shape
    assert np.allclose(*colours) != is_random
