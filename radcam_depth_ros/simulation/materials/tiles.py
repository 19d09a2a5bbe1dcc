"""Paints texture tiles: asphalt, paving, plants, facades, and random patterns."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.lettering import livery, poster, write
from radcam_depth_ros.simulation.materials.surfaces import FACADES, LIVERIES, Colour, Texture
from radcam_depth_ros.simulation.materials.wear import chippings, leaves

TILE = 256
"""Pixels along a side of a tile at its finest."""


def fractal(rng: np.random.Generator, size: int, roughness: float, coarsest: float = 1.0) -> FloatArray:
    """Noise that tiles: (size, size) float32 of mean 0 and deviation 1.

    Args:
        rng: Random generator.
        size: Pixels along a side.
        roughness: Amplitude falls with frequency to this power: 0 is white noise, 2 is clouds.
        coarsest: Waves longer than `size / coarsest` are left out.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]) * size
    gain = np.where(frequency >= coarsest, np.maximum(frequency, 1e-6) ** -roughness, 0.0)
    noise = np.fft.irfft2(spectrum * gain, s=(size, size))
    return np.asarray((noise - noise.mean()) / (noise.std() + 1e-12), np.float32)


def paint_tiles(rng: np.random.Generator, lettering: bool = False, wear: bool = False) -> list[FloatArray]:
    """The tiles of a world in the order of `Texture`: (TILE, TILE, 4) float32, colour and gloss.

    Args:
        rng: Random generator.
        lettering: Whether something is written on vehicles, shops and boards.
        wear: Whether plants and roads have fine detail.
    """
    painters: dict[Texture, Callable[[np.random.Generator], npt.NDArray[np.floating]]] = {
        Texture.PLAIN: lambda _: _grey(np.ones((TILE, TILE))),
        Texture.ASPHALT: _asphalt,
        Texture.ASPHALT_PATCHED: _patched_asphalt,
        Texture.MARK: lambda r: _grey(np.clip(0.92 + 0.16 * fractal(r, TILE, 0.9), 0.25, 1.1)),
        Texture.PAVING: lambda r: _slabs(r, 4, 4, 0.08, 0.0),
        Texture.COBBLES: lambda r: _slabs(r, 16, 12, 0.22, 0.5),
        Texture.GRASS: lambda r: _mottled(r, 0.35, 0.6, (0.25, 0.05, -0.1)),
        Texture.SOIL: lambda r: _mottled(r, 0.28, 0.8, (0.05, 0.0, -0.05)),
        Texture.SNOW: _snow,
        Texture.LEAF: lambda r: _mottled(r, 0.45, 0.25, (0.2, 0.0, -0.1)),
        Texture.BARK: lambda r: _grey(1 + 0.35 * fractal(r, TILE, 0.8)),
        Texture.CLOTH: lambda r: _grey(1 + 0.12 * fractal(r, TILE, 0.9)),
        Texture.ROOF: _roof_tiles,
        Texture.METAL: lambda r: _grey(1 + 0.08 * fractal(r, TILE, 1.2)),
        Texture.PLANKS: _planks,
        Texture.HEDGE: lambda r: _mottled(r, 0.55, 0.35, (0.2, 0.0, -0.1)),
        Texture.SIGN: _sign,
        Texture.SHOP: _shop,
        Texture.GRILLE: _grille,
        Texture.ASPHALT_WORN: _worn_asphalt,
        Texture.CONCRETE: _concrete,
        Texture.GRAVEL: _gravel,
        Texture.LITTER: _litter,
        Texture.STRIPES: _stripes,
        Texture.BRICK: lambda r: _slabs(r, 8, 24, 0.12, 0.5),
        **dict.fromkeys(FACADES, _facade),
        **dict.fromkeys(LIVERIES, lambda _: _grey(np.ones((TILE, TILE)))),
        Texture.POSTER: _sign,
    }
    painters |= _LETTERED if lettering else {}
    painters |= _WORN if wear else {}
    tiles = []
    for texture in Texture:
        tile = np.asarray(painters[texture](rng), np.float32)
        if tile.shape[-1] == 3:
            # Without a gloss channel of its own a material is as glossy as its surface.
            tile = np.concatenate([tile, np.ones((TILE, TILE, 1), np.float32)], axis=-1)
        tiles.append(np.clip(tile, 0.0, 1.0))
    return tiles


def _grey(values: npt.NDArray[np.floating]) -> FloatArray:
    return np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=-1)


def _mottled(rng: np.random.Generator, amplitude: float, roughness: float, hue: Colour) -> npt.NDArray[np.floating]:
    base = 0.6 * (1 + amplitude * (0.7 * fractal(rng, TILE, roughness, 4) + 0.5 * fractal(rng, TILE, 1.3)))
    return base[..., None] * (1 + np.array(hue) * fractal(rng, TILE, 1.0)[..., None])


def _asphalt(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    grain = rng.uniform(0.03, 0.15) * fractal(rng, TILE, 0.25, 8)
    blotch = rng.uniform(0.03, 0.12) * fractal(rng, TILE, 1.6)
    return _grey(0.7 * (1 + grain + blotch))


def _patched_asphalt(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    tile = np.array(_asphalt(rng), np.float32)
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.integers(0, TILE - 40, 2)
        width, height = rng.integers(16, 110, 2)
        tile[y : y + height, x : x + width] *= rng.uniform(0.6, 1.25)
    for _ in range(int(rng.integers(2, 7))):
        # Cracks wander; tar that seals them is darker than the road.
        steps = np.cumsum(rng.normal(0, 4, (40, 2)) + rng.normal(0, 3, 2), axis=0) + rng.uniform(0, TILE, 2)
        line = steps.astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(tile, [line], False, [rng.uniform(0.2, 0.4)] * 3, int(rng.integers(1, 3)))
    return tile


def _worn_asphalt(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Coarse chippings, a net of cracks, stains of oil."""
    tile = 0.62 * (1 + rng.uniform(0.1, 0.3) * fractal(rng, TILE, 0.1, 30) + 0.12 * fractal(rng, TILE, 1.3))
    net = np.abs(fractal(rng, TILE, 1.1, 3))
    tile *= np.where(net < rng.uniform(0.01, 0.06), rng.uniform(0.3, 0.7), 1.0)
    stain = np.clip(fractal(rng, TILE, 1.8, 2) - 1.3, 0, 1)
    return _grey(tile * (1 - 0.5 * stain))


def _concrete(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Plates with joints, streaks of weather."""
    tile = 0.75 * (1 + 0.05 * fractal(rng, TILE, 0.4) + 0.1 * fractal(rng, TILE, 1.5))
    tile *= 1 + 0.03 * fractal(rng, TILE, 1.0)[:1]
    joint = int(rng.integers(2, 4))
    tile[:joint] *= rng.uniform(0.25, 0.7)
    if rng.random() < 0.6:
        tile[:, :joint] *= rng.uniform(0.25, 0.7)
    return _grey(tile)


def _gravel(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    grain = fractal(rng, TILE, rng.uniform(0.0, 0.5), 12)
    return _grey(0.6 * (1 + 0.35 * grain + 0.15 * fractal(rng, TILE, 1.2)))


def _litter(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Grass or soil under fallen leaves and twigs."""
    tile = np.array(_mottled(rng, 0.35, 0.6, (0.2, 0.05, -0.1)), np.float32)
    colours = np.array([(0.9, 0.5, 0.15), (0.6, 0.25, 0.1), (0.9, 0.75, 0.3), (0.3, 0.2, 0.15)])
    for _ in range(int(rng.integers(100, 500))):
        centre = tuple(int(v) for v in rng.integers(0, TILE, 2))
        axes = (int(rng.integers(2, 7)), int(rng.integers(1, 4)))
        colour = colours[int(rng.integers(4))] * rng.uniform(0.5, 1.1)
        cv2.ellipse(tile, centre, axes, rng.uniform(0, 360), 0, 360, colour.tolist(), -1)
    return tile


def _stripes(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Slanting stripes, white and the colour of the material."""
    y, x = np.mgrid[0:TILE, 0:TILE]
    white = ((x + y) // (TILE // 4)) % 2 == 0
    colour: FloatArray = np.where(white[..., None], 1.0, np.array([0.9, 0.3, 0.3])).astype(np.float32)
    return colour * (0.9 + 0.05 * fractal(rng, TILE, 0.8)[..., None])


def random_tiles(rng: np.random.Generator) -> list[FloatArray]:
    """Tiles of random patterns in random colours, likewise; PLAIN stays plain."""
    tiles = []
    for texture in Texture:
        if texture is Texture.PLAIN:
            pattern = np.ones((TILE, TILE, 3))
        else:
            share = np.clip(_pattern(rng), 0, 1)[..., None]
            first, second = rng.uniform(0.05, 1.0, (2, 3))
            grain = 1 + rng.uniform(0, 0.3) * fractal(rng, TILE, 0.5)[..., None]
            pattern = (first * share + second * (1 - share)) * grain
        gloss = np.full((TILE, TILE, 1), float(rng.uniform(0, 1) ** 2))
        tiles.append(np.clip(np.concatenate([pattern, gloss], axis=-1), 0, 1).astype(np.float32))
    return tiles


def _pattern(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """(TILE, TILE) 0 to 1: clouds, spots, stripes, checks or cells."""
    y, x = np.mgrid[0:TILE, 0:TILE] * (2 * np.pi / TILE)
    kind = int(rng.integers(5))
    if kind == 0:
        return 0.5 + 0.5 * fractal(rng, TILE, rng.uniform(0.0, 2.0))
    if kind == 1:
        return np.asarray(fractal(rng, TILE, 1.2, float(rng.integers(2, 12))) > rng.uniform(-1, 1), np.float64)
    a, b = (int(v) for v in rng.integers(0, 12, 2))
    wave = np.sin(a * x + b * y + rng.uniform(0, 6))
    if kind == 2:
        return np.asarray(np.clip(0.5 + wave * rng.uniform(0.5, 5), 0, 1))
    c, d = (int(v) for v in rng.integers(1, 12, 2))
    checks = np.sin(c * x) * np.sin(d * y)
    if kind == 3:
        return np.asarray(checks > 0, np.float64)
    return np.asarray(np.clip(0.5 + checks + 0.3 * fractal(rng, TILE, 1.0), 0, 1))


def _slabs(rng: np.random.Generator, across: int, along: int, spread: float, shift: float) -> npt.NDArray[np.floating]:
    tile = np.empty((TILE, TILE))
    y = np.arange(TILE)
    row = y * along // TILE
    x = np.arange(TILE)
    tone = 0.72 + spread * rng.standard_normal((along, across))
    for line in range(TILE):
        offset = int((row[line] % 2) * shift * TILE / across)
        position = (x + offset) % TILE
        tile[line] = tone[row[line], position * across // TILE]
        tile[line, (position % (TILE / across)) < 2] *= 0.6
    tile[(y % (TILE / along)) < 2] *= 0.6
    return _grey(tile * (1 + 0.08 * fractal(rng, TILE, 0.6)))


def _snow(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    cover = np.clip(1.2 + 1.1 * fractal(rng, TILE, 1.4), 0, 1)[..., None]
    ground = np.array([0.16, 0.15, 0.11]) * (1 + 0.3 * fractal(rng, TILE, 0.6)[..., None])
    white = 0.9 + 0.05 * fractal(rng, TILE, 0.8)[..., None]
    return np.asarray(cover * white + (1 - cover) * ground, np.float32)


def _roof_tiles(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    y, x = np.mgrid[0:TILE, 0:TILE]
    ribs = 0.8 + 0.12 * np.sin(x / TILE * 2 * np.pi * 24) - 0.25 * ((y % 16) < 3)
    return _grey(ribs * (1 + 0.12 * fractal(rng, TILE, 1.0)))


def _planks(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    board = np.repeat(rng.uniform(0.6, 1.0, 16), TILE // 16)[None] * np.ones((TILE, 1))
    board[:, (np.arange(TILE) % 16) < 2] *= 0.35
    return _grey(board * (1 + 0.15 * fractal(rng, TILE, 0.8)))


def _grille(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    tile = np.full((TILE, TILE), 0.25)
    tile[(np.arange(TILE) % 32) < 8] = 0.6
    return _grey(tile * (1 + 0.05 * fractal(rng, TILE, 0.8)))


def _sign(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    tile = np.ones((TILE, TILE, 3))
    for _ in range(int(rng.integers(2, 6))):
        x, y = rng.integers(20, 180, 2)
        width, height = rng.integers(10, 120), rng.integers(6, 30)
        tile[y : y + height, x : x + width] = rng.choice([0.02, 0.9]) * np.ones(3)
    return tile


def _facade(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Two bays by two floors of windows; the wall itself is white, the building colours it."""
    tile = np.ones((TILE, TILE, 4)) * 0.8
    tile[..., :3] *= (1 + 0.05 * fractal(rng, TILE, 0.5) + 0.07 * fractal(rng, TILE, 1.6))[..., None]
    if rng.random() < 0.35:
        tile[:: int(rng.integers(5, 10)), :, :3] *= 0.8
    tile[..., 3] = 0.0
    if rng.random() < 0.4:
        tile[:8, :, :3] *= rng.uniform(0.6, 1.2)
        tile[128:136, :, :3] *= rng.uniform(0.6, 1.2)
    height, width = int(rng.integers(46, 92)), int(rng.integers(36, 112))
    frame = rng.uniform(0.5, 1.25)
    bars = int(rng.integers(0, 3))
    for row in (0, 128):
        for column in (0, 128):
            y, x = row + (118 - height) // 2 + 6, column + (128 - width) // 2
            tile[y - 4 : y + height + 4, x - 4 : x + width + 4, :3] *= frame
            _window(rng, tile[y : y + height, x : x + width], bars)
            if rng.random() < 0.15:
                blind = int(height * rng.uniform(0.2, 0.9))
                tile[y : y + blind, x : x + width] = [0.55, 0.53, 0.5, 0.0]
    return tile


def _window(rng: np.random.Generator, pane: npt.NDArray[np.floating], bars: int) -> None:
    height, width = pane.shape[:2]
    tone = rng.uniform(0.01, 0.14)
    shade = np.linspace(rng.uniform(0.8, 1.6), rng.uniform(0.5, 1.0), height)[:, None, None]
    pane[..., :3] = tone * shade * np.array([0.9, 1.0, 1.05])
    pane[..., 3] = 1.0
    for bar in range(1, bars + 1):
        x = width * bar // (bars + 1)
        pane[:, x - 2 : x + 2] = [0.6, 0.6, 0.6, 0.0]


def _shop(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    tile = np.ones((TILE, TILE, 4)) * 0.55
    tile[..., 3] = 0.0
    tile[20:56, 8:248, :3] = rng.uniform(0.05, 1.0, 3)
    for x in range(30, 220, 22):
        if rng.random() < 0.8:
            tile[28:48, x : x + 14, :3] = rng.choice([0.03, 0.95])
    for x in (12, 92, 172):
        _window(rng, tile[64:240, x : x + 72], 1)
        if rng.random() < 0.5:
            tile[120:236, x + 8 : x + 60, :3] += rng.uniform(0, 0.25, 3)
    return tile


def _lettered_shop(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """A shop front with a name over it and prints in its windows."""
    tile = np.asarray(_shop(rng), np.float32)
    sign = np.full((36, 240, 3), rng.uniform(0.02, 0.9, 3), np.float32)
    write(rng, sign, rng.uniform(12, 22))
    tile[20:56, 8:248, :3] = sign
    for x in (12, 92, 172):
        if rng.random() < 0.5:
            tile[90:180, x + 6 : x + 66, :3] = cv2.resize(poster(rng, 64)[::-1], (60, 90))
    return tile


def _lettered_sign(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Lines of words, often on a darker ground; its first row is the lowest."""
    tile = np.full((TILE, TILE, 3), rng.uniform(0.35, 1.0), np.float32)
    for _ in range(int(rng.integers(2, 6))):
        write(rng, tile, TILE * float(rng.uniform(0.06, 0.25)))
    return tile[::-1]


def _leafy(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    shade = 1 + 0.15 * fractal(rng, TILE, 1.3) + 0.2 * fractal(rng, TILE, 0.25, 4)
    return leaves(rng, TILE, 700, rng.uniform(5, 11)) * shade[..., None]


def _clipped(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    shade = 1 + 0.2 * fractal(rng, TILE, 1.3) + 0.2 * fractal(rng, TILE, 0.35, 4)
    return leaves(rng, TILE, 900, rng.uniform(3, 6)) * shade[..., None]


def _meadow(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    """Blades and tufts between bare spots."""
    blades = 1 + 0.45 * fractal(rng, TILE, 0.1, 12) + 0.3 * fractal(rng, TILE, 0.9, 3)
    tile = (
        0.55
        * np.clip(blades, 0.1, 2.2)[..., None]
        * (1 + np.array((0.25, 0.05, -0.1)) * fractal(rng, TILE, 1.0)[..., None])
    )
    bare = np.clip(fractal(rng, TILE, 1.5, 2) - 1.2, 0, 1)[..., None]
    return np.asarray(tile * (1 - bare) + bare * np.array((0.6, 0.5, 0.45)), np.float32)


def _stony(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    return _asphalt(rng) * chippings(rng, TILE)[..., None]


def _stony_patched(rng: np.random.Generator) -> npt.NDArray[np.floating]:
    return _patched_asphalt(rng) * chippings(rng, TILE)[..., None]


_LETTERED: dict[Texture, Callable[[np.random.Generator], npt.NDArray[np.floating]]] = {
    **dict.fromkeys(LIVERIES, lambda r: livery(r, TILE)),
    Texture.POSTER: lambda r: poster(r, TILE),
    Texture.SHOP: _lettered_shop,
    Texture.SIGN: _lettered_sign,
}
_WORN: dict[Texture, Callable[[np.random.Generator], npt.NDArray[np.floating]]] = {
    Texture.LEAF: _leafy,
    Texture.HEDGE: _clipped,
    Texture.GRASS: _meadow,
    Texture.ASPHALT: _stony,
    Texture.ASPHALT_PATCHED: _stony_patched,
}
