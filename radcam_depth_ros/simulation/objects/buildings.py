"""Buildings: blocks, houses with pitched roofs, halls; with shops, balconies and chimneys."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import FACADES, Colour, Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, quads
from radcam_depth_ros.simulation.settings.randomness import pick

_WALLS = (
    (0.75, 0.72, 0.66),
    (0.85, 0.84, 0.82),
    (0.62, 0.50, 0.34),
    (0.42, 0.20, 0.13),
    (0.36, 0.36, 0.37),
    (0.55, 0.55, 0.53),
    (0.70, 0.60, 0.42),
    (0.30, 0.22, 0.17),
    (0.50, 0.56, 0.60),
    (0.14, 0.14, 0.15),
)
_AWNINGS = ((0.5, 0.08, 0.05), (0.1, 0.2, 0.1), (0.6, 0.5, 0.3))
_BOARDS = ((0.6, 0.05, 0.04), (0.05, 0.1, 0.4), (0.8, 0.6, 0.05), (0.8, 0.8, 0.8))
_RAILS = ((0.5, 0.5, 0.5), (0.1, 0.1, 0.1), (0.7, 0.7, 0.65))
_ROOFS = ((0.35, 0.13, 0.08), (0.22, 0.08, 0.06), (0.10, 0.10, 0.11), (0.20, 0.17, 0.15))


def _tone(rng: np.random.Generator, palette: tuple[Colour, ...]) -> Colour:
    base = np.array(pick(rng, palette)) * rng.uniform(0.75, 1.15) + rng.normal(0, 0.015, 3)
    r, g, b = np.clip(base, 0.02, 0.95)
    return float(r), float(g), float(b)


def town_block(rng: np.random.Generator, length: float, depth: float, height: float) -> Mesh:
    """A block with flat or mansard roof; its front is at y = 0 and it reaches to y = depth, along x from 0."""
    wall = Material(Surface.MASONRY, Label.BUILDING, _tone(rng, _WALLS), pick(rng, FACADES), 6.4)
    plain = Material(Surface.ROOF, Label.BUILDING, _tone(rng, _ROOFS), Texture.ROOF, 3.0)
    ground = 3.6 if rng.random() < 0.5 else 0.0
    storeys = max(1, round((height - ground) / 3.2))
    top = ground + storeys * 3.2
    parts = [_walls(length, depth, ground, top, wall)]
    if ground > 0:
        shop = Material(Surface.MASONRY, Label.BUILDING, _tone(rng, _WALLS), Texture.SHOP, 3.6)
        parts.append(_walls(length, depth, 0.0, ground, shop))
        if rng.random() < 0.4:
            awning = Material(Surface.CANVAS, Label.BUILDING, _tone(rng, _AWNINGS))
            x = rng.uniform(0, length * 0.5)
            stop = x + length * 0.4
            parts.append(quads([[(x, 0, 3.1), (stop, 0, 3.1), (stop, -1.4, 2.6), (x, -1.4, 2.6)]], awning))
    if rng.random() < 0.45:
        parts.append(_pitched_roof(length, depth, top, rng.uniform(2.0, 4.5), plain, overhang=0.4))
    else:
        parts.append(box([length + 0.3, depth + 0.3, 0.5], [length / 2, depth / 2, top + 0.25], wall_trim(wall)))
    if rng.random() < 0.35:
        parts.append(_balconies(rng, length, ground, storeys))
    return join(parts)


def wall_trim(wall: Material) -> Material:
    """The wall's colour without its windows."""
    return Material(Surface.ROOF, Label.BUILDING, wall.colour)


def house(rng: np.random.Generator, length: float, depth: float) -> Mesh:
    """A house for one or two families with a pitched roof; placed as `town_block` is."""
    wall = Material(Surface.MASONRY, Label.BUILDING, _tone(rng, _WALLS), pick(rng, FACADES), 6.0)
    roof = Material(Surface.ROOF, Label.BUILDING, _tone(rng, _ROOFS), Texture.ROOF, 2.5)
    eaves = 3.0 * float(rng.integers(1, 3)) + 0.3
    rise = rng.uniform(2.0, 4.0)
    parts = [_walls(length, depth, 0.0, eaves, wall)]
    along = rng.random() < 0.5
    run, span = (length, depth) if along else (depth, length)
    top = _pitched_roof(run, span, eaves, rise, roof, overhang=0.6)
    ridge = (span / 2, eaves + rise)
    gables = np.array([[(x, 0, eaves), (x, span, eaves), (x, *ridge), (x, *ridge)] for x in (0.0, run)])
    parts.append(top if along else top.with_axes(1, 0, 2))
    parts.append(quads(gables if along else gables[..., [1, 0, 2]], wall_trim(wall)))
    brick = Material(Surface.MASONRY, Label.BUILDING, (0.3, 0.14, 0.1))
    parts.append(box([0.6, 0.6, 1.6], [length * 0.3, depth * 0.42, eaves + rise], brick))
    return join(parts)


def hall(rng: np.random.Generator, length: float, depth: float, height: float) -> Mesh:
    """A warehouse or supermarket: sheet metal, few windows, letters on the front."""
    texture = (Texture.PLANKS, Texture.METAL, Texture.GRILLE)
    cladding = Material(Surface.METAL, Label.BUILDING, _tone(rng, _WALLS), pick(rng, texture), 3.0)
    parts = [
        _walls(length, depth, 0.0, height, cladding),
        box([length, depth, 0.3], [length / 2, depth / 2, height], wall_trim(cladding)),
    ]
    if rng.random() < 0.7:
        shop = Material(Surface.MASONRY, Label.BUILDING, _tone(rng, _WALLS), Texture.SHOP, 3.6)
        start, stop = np.sort(rng.uniform(0, length, 2))
        front = [(start, -0.06, 0), (stop, -0.06, 0), (stop, -0.06, 3.6), (start, -0.06, 3.6)]
        columns = (stop - start) / 3.6
        parts.append(quads([front], shop, [[(0, 1), (columns, 1), (columns, 0), (0, 0)]]))
    board = Material(Surface.SIGN_FACE, Label.BUILDING, _tone(rng, _BOARDS), Texture.SIGN)
    x = rng.uniform(0, length * 0.6)
    parts.append(box([length * 0.25, 0.2, 1.4], [x + length * 0.125, -0.1, height - 0.9], board))
    return join(parts)


def _walls(length: float, depth: float, low: float, high: float, wall: Material) -> Mesh:
    """Four walls whose texture is stretched to whole tiles, so that no window is cut."""
    corners = [(0.0, 0.0), (length, 0.0), (length, depth), (0.0, depth)]
    faces, uvs = [], []
    rows = max(1.0, np.round((high - low) / wall.tile_m * 2)) / 2
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        columns = max(1.0, np.round(np.hypot(bx - ax, by - ay) / wall.tile_m * 2)) / 2
        faces.append([(ax, ay, low), (bx, by, low), (bx, by, high), (ax, ay, high)])
        uvs.append([(0, rows), (columns, rows), (columns, 0), (0, 0)])
    return quads(faces, wall, uvs)


def _pitched_roof(length: float, depth: float, eaves: float, rise: float, roof: Material, overhang: float) -> Mesh:
    low = eaves - overhang * rise / (depth / 2)
    x0, x1, y0, y1 = -overhang, length + overhang, -overhang, depth + overhang
    ridge = eaves + rise
    return quads(
        [
            [(x0, y0, low), (x1, y0, low), (x1, depth / 2, ridge), (x0, depth / 2, ridge)],
            [(x1, y1, low), (x0, y1, low), (x0, depth / 2, ridge), (x1, depth / 2, ridge)],
        ],
        roof,
    )


def _balconies(rng: np.random.Generator, length: float, ground: float, storeys: int) -> Mesh:
    rail = Material(Surface.METAL, Label.BUILDING, _tone(rng, _RAILS))
    width = rng.uniform(2.2, 3.6)
    return join(
        [
            box([width, 1.2, 1.05], [x + width / 2, -0.6, ground + storey * 3.2 + 0.4], rail)
            for storey in range(1 if ground == 0 else 0, storeys)
            for x in np.arange(1.5, length - width, width * 2.0)
        ]
        or [box([width, 0.3, 0.2], [length / 2, -0.15, ground + 3.0], rail)]
    )
