from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.simulation.materials.surfaces import LIVERIES, Label, Material, Surface, Texture
from radcam_depth_ros.simulation.materials.textures import TextureAtlas
from radcam_depth_ros.simulation.materials.tiles import TILE, fractal, paint_tiles, random_tiles
from radcam_depth_ros.simulation.materials.wear import road_wear

PLAIN = Material(Surface.METAL, Label.POLE)


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


def test_looking_nothing_up_gives_nothing() -> None:
    none = np.zeros(0, np.float32)
    colour, gloss = TextureAtlas(np.random.default_rng(0)).sample(np.zeros(0, np.uint8), none.reshape(0, 2), none)
    assert (colour.shape, gloss.shape) == ((0, 3), (0,))


def test_random_tiles_are_tiles() -> None:
    tiles = random_tiles(np.random.default_rng(0))
    assert len(tiles) == len(Texture)
    for tile in tiles:
        assert tile.shape == (TILE, TILE, 4)
        assert 0 <= tile.min() <= tile.max() <= 1


def test_lettering_and_wear_change_their_own_tiles_only() -> None:
    plain, painted = paint_tiles(np.random.default_rng(0)), paint_tiles(np.random.default_rng(0), True, True)
    assert len(plain) == len(painted) == len(Texture)
    for tile in painted:
        assert tile.shape == (TILE, TILE, 4)
        assert 0 <= tile.min() <= tile.max() <= 1
    for texture in LIVERIES:
        assert plain[texture].std() == 0
        assert painted[texture].std() > 0.01
    # Roads have more fine detail.
    fine = [float(np.abs(np.diff(tiles[Texture.ASPHALT][..., 1], axis=1)).mean()) for tiles in (plain, painted)]
    assert fine[1] > fine[0]


def test_wear_of_roads_tiles_and_stays_near_the_roads_own_albedo() -> None:
    for seed in range(5):
        wear = road_wear(np.random.default_rng(seed))
        assert wear.dtype == np.float32
        assert 0 < wear.min() <= wear.max() < 1.5
        assert 0.7 < wear.mean() < 1.2
