"""Builds the land behind the sidewalk: houses, gardens, forest, fields, halls."""

from __future__ import annotations

from functools import partial

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture, scaled
from radcam_depth_ros.simulation.objects import buildings, furniture, plants
from radcam_depth_ros.simulation.objects.animals import AnimalKind
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.settings.randomness import pick
from radcam_depth_ros.simulation.settings.style import Land
from radcam_depth_ros.simulation.world.lots import fill_lot, fill_open, lay_driveways
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch


def settle(stretch: Stretch, sign: int, land: Land) -> None:
    """Puts what belongs to a kind of land on one side (1 left, -1 right) of a stretch."""
    builders = {
        Land.BLOCKS: _blocks,
        Land.HOUSES: _houses,
        Land.FOREST: _forest,
        Land.FIELD: _field,
        Land.HALLS: _halls,
        Land.PARK: _park,
        Land.NOISE_WALL: _noise_wall,
        Land.LOT: fill_lot,
        Land.OPEN: fill_open,
    }
    builders[land](stretch, sign)


def _along(stretch: Stretch, sign: int, start: float, length: float) -> float:
    """Where a mesh that begins at its origin must be put: on the right it is turned round, so it begins at its end."""
    return start if sign > 0 else start + length


def _blocks(stretch: Stretch, sign: int) -> None:
    style, rng = stretch.style, stretch.rng
    side, _ = stretch.side(sign)
    s = stretch.start_m + rng.uniform(-1, 2)
    while s < stretch.stop_m - 7:
        length = min(rng.uniform(9, 26), stretch.stop_m - s)
        if stretch.crosses(s, s + length):
            half = style.crossing_half_m + 2.9
            if s < stretch.crossing_m - half - 7.5:
                length = stretch.crossing_m - half - s
            else:
                s = max(s + 2.0, stretch.crossing_m + half)
                continue
        block = buildings.town_block(rng, length, rng.uniform(10, 15), rng.uniform(6, 24))
        setback = side.land_m + style.setback_m * rng.uniform(0.6, 1.4)
        stretch.place_facing_road(block, sign, _along(stretch, sign, s, length), setback)
        s += length + (rng.uniform(2, 9) if rng.random() < 0.25 else 0.0)
    _trees(stretch, sign, 3, 22.0, 45.0)


def _houses(stretch: Stretch, sign: int) -> None:
    style, rng = stretch.style, stretch.rng
    side, _ = stretch.side(sign)
    setback = side.land_m + style.setback_m
    s = stretch.start_m + rng.uniform(0, 5)
    while s < stretch.stop_m - 9:
        length, depth = rng.uniform(8, 14), rng.uniform(8, 12)
        if not stretch.crosses(s, s + length):
            house = buildings.house(rng, length, depth)
            outwards = setback * rng.uniform(0.9, 1.3)
            stretch.place_facing_road(house, sign, _along(stretch, sign, s, length), outwards, depth)
        s += length + rng.uniform(3, 12)
    _boundary(stretch, sign)
    lay_driveways(stretch, sign)
    _trees(stretch, sign, int(rng.integers(1, 7)), 1.5, max(style.setback_m, 4.0))
    _trees(stretch, sign, int(rng.integers(2, 8)), 22.0, 50.0)
    _bushes(stretch, sign, int(rng.integers(2, 9)), 1.0, 8.0)


def _boundary(stretch: Stretch, sign: int) -> None:
    """Hedges, fences and walls between gardens and sidewalk, in pieces with gates between them."""
    style, rng = stretch.style, stretch.rng
    s = stretch.start_m
    while s < stretch.stop_m - 4:
        length = rng.uniform(6, 18)
        length = min(length, stretch.stop_m - s)
        kind, height, wide = int(rng.integers(7)), rng.uniform(0.7, 1.9), rng.uniform(0.6, 1.1)
        if not stretch.crosses(s, s + length) and kind < 6:
            leaf = style.twig if kind == 1 and style.bare > 0.5 else style.foliage
            state = rng.integers(2**31)

            # All pieces of one fence look the same: each is drawn anew from the same state.
            def piece(
                chord: float, kind: int = kind, height: float = height, wide: float = wide, state: int = int(state)
            ) -> Mesh:
                own = np.random.default_rng(state)
                if kind < 2:
                    return plants.hedge(own, chord, wide, height, leaf)  # noqa: B023  # used at once
                if kind == 5:
                    return furniture.wire_fence(chord, height)
                build = (furniture.picket_fence, furniture.panel_fence, furniture.garden_wall)[kind - 2]
                return build(own, chord, min(height, 1.4) if kind == 2 else height * (0.7 if kind == 4 else 1.0))

            stretch.place_along_land(piece, sign, s, s + length, 0.6, -0.02)
        s += length + pick(rng, (0.0, 1.2, 3.5))


def _forest(stretch: Stretch, sign: int) -> None:
    style, rng = stretch.style, stretch.rng
    side, edge = stretch.side(sign)
    start = rng.uniform(2.5, 9.0)
    for row in range(3):
        depth = start + row * 3.6
        pitch = 3.6 + 0.7 * row
        for s in np.arange(stretch.start_m, stretch.stop_m, pitch):
            at, out = float(s + rng.normal(0, 1)), depth + rng.normal(0, 0.9)
            if stretch.crosses(at, at):
                continue
            plant = stretch.library.draw_tree(rng, style)
            mesh = plant.near if row == 0 and rng.random() < 0.5 else plant.far
            stretch.place_on_land(mesh, sign, at, out, -0.1, rng.uniform(0, 6.28), rng.uniform(0.8, 1.4))
    # Behind the last row it is dark.
    tone = rng.uniform(0.2, 0.6)
    colour = style.twig if style.bare > 0.5 and style.conifers < 0.3 else style.foliage
    dark = Material(Surface.FOLIAGE, Label.VEGETATION, scaled(colour, tone), Texture.LEAF, 5.0)
    back = edge + side.land_m + start + 13.0
    s = np.linspace(stretch.start_m, stretch.stop_m, 18)
    foot = stretch.ground_m(sign, s, start + 13.0) - 1.0
    crown = foot + 1.0 + rng.uniform(3.0, 7.0, len(s)) * np.clip(4 - 4 * np.abs(np.linspace(-1, 1, len(s))), 0.3, 1)
    stretch.grid(s, sign * np.array([back, back + 0.8]), np.stack([foot, crown], 1), dark)
    _bushes(stretch, sign, 16, start - 1.5, start + 2.0)


def _field(stretch: Stretch, sign: int) -> None:
    style, rng = stretch.style, stretch.rng
    _, edge = stretch.side(sign)
    if rng.random() < 0.5:
        colours = ((0.35, 0.27, 0.1), (0.1, 0.07, 0.05), (0.1, 0.16, 0.04), (0.25, 0.22, 0.08))
        crop = Material(Surface.GROUND, Label.TERRAIN, pick(rng, colours), Texture.SOIL, 8.0)
        reach = np.array([5.0, 10.0, 16.0, 25.0, 38.0, 52.0, 70.0])
        lift = rng.uniform(0.1, 0.5)
        for first, last in [] if style.snow else stretch.spans:
            stretch.cover_land(sign, first, last, reach, lift, crop)
    if rng.random() < 0.6:
        _trees(stretch, sign, int(rng.integers(1, 4)), 4.0, 40.0)
    if rng.random() < 0.3:
        _bushes(stretch, sign, 14, 2.0, 4.0)
    if rng.random() < 0.12:
        stretch.place(furniture.pylon(), stretch.start_m + 20, sign * (edge + rng.uniform(30, 80)), -0.3)
    if rng.random() < 0.08:
        _herd(stretch, sign)
    _tree_line(stretch, sign)


def _herd(stretch: Stretch, sign: int) -> None:
    """Horses, cows or deer that graze."""
    rng = stretch.rng
    animal = stretch.library.animals[pick(rng, (AnimalKind.DEER, AnimalKind.HORSE, AnimalKind.COW))]
    for _ in range(int(rng.integers(1, 7))):
        s, out = rng.uniform(stretch.start_m, stretch.stop_m), rng.uniform(5, 30)
        stretch.place_on_land(animal, sign, s, out, -0.02, rng.uniform(0, 6.28))


def _halls(stretch: Stretch, sign: int) -> None:
    rng = stretch.rng
    side, edge = stretch.side(sign)
    setback = side.land_m + rng.uniform(8, 28)
    if not np.isfinite(stretch.crossing_m):
        length = rng.uniform(25, STRETCH_M - 1)
        hall = buildings.hall(rng, length, rng.uniform(15, 35), rng.uniform(4, 11))
        stretch.place_facing_road(hall, sign, _along(stretch, sign, stretch.start_m, length), setback, 20.0)
    tone = stretch.style.asphalt * rng.uniform(0.7, 1.6)
    lot = Material(Surface.ASPHALT, Label.ROAD, (tone, tone, tone), Texture.ASPHALT, 6.0)
    near, far = edge + side.land_m + 2.0, edge + setback - 1.0
    for first, last in stretch.spans:
        s = np.linspace(first, last, max(2, int((last - first) / 5.0)))
        t = np.linspace(near, far, 4)
        along, across = np.meshgrid(s, t, indexing="ij")
        stretch.grid(s, sign * t, stretch.ground_m(sign, along, across - edge - side.land_m) + 0.05, lot)
    if setback - side.land_m > 12:
        for at in np.arange(stretch.start_m + 2, stretch.stop_m - 2, 2.8):
            if rng.random() < 0.6 and not stretch.crosses(float(at), float(at)):
                out = side.land_m + 5.5
                z = float(stretch.ground_m(sign, at, out - side.land_m)) + 0.05
                car = stretch.library.draw_parked(rng).mesh
                turned = pick(rng, (-1.0, 1.0)) * np.pi / 2 + rng.normal(0, 0.03)
                stretch.place(car, float(at), sign * (edge + out), z, turned)
    _trees(stretch, sign, 2, 1.0, 2.5)
    if rng.random() < 0.4:
        fence = partial(furniture.wire_fence, height=rng.uniform(1.2, 2.2))
        for first, last in stretch.spans:
            stretch.place_along(fence, sign, first, last, sign * (edge + side.land_m + 0.8))


def _park(stretch: Stretch, sign: int) -> None:
    rng = stretch.rng
    _trees(stretch, sign, int(rng.integers(3, 12)), 2.0, 30.0)
    _bushes(stretch, sign, int(rng.integers(0, 12)), 1.5, 12.0)
    _tree_line(stretch, sign)


def _noise_wall(stretch: Stretch, sign: int) -> None:
    look, height = furniture.noise_wall_look(stretch.rng), stretch.rng.uniform(2.5, 4.5)
    for start, stop in stretch.spans:
        stretch.place_along_land(partial(furniture.noise_wall, height=height, face=look), sign, start, stop, 4.0, -0.1)
    _trees(stretch, sign, 6, 6.0, 14.0)


def _tree_line(stretch: Stretch, sign: int) -> None:
    """A wood or a row of houses far from the road, which closes the view."""
    rng, style = stretch.rng, stretch.style
    side, edge = stretch.side(sign)
    out = rng.uniform(50, 75)
    if rng.random() < 0.2:
        house = buildings.house(rng, 12.0, 10.0)
        stretch.place_facing_road(house, sign, stretch.start_m + 25, side.land_m + out, 10.0)
        return
    for s in np.arange(stretch.start_m, stretch.stop_m, rng.uniform(3.5, 9)):
        plant = stretch.library.draw_tree(rng, style)
        z = float(stretch.ground_m(sign, s, out)) - 0.2
        t = sign * (edge + side.land_m + out + rng.normal(0, 2))
        stretch.place(plant.far, float(s), t, z, rng.uniform(0, 6.28), rng.uniform(0.9, 1.5))


def _trees(stretch: Stretch, sign: int, count: int, low: float, high: float) -> None:
    _scatter(stretch, sign, count, low, high, trees=True)


def _bushes(stretch: Stretch, sign: int, count: int, low: float, high: float) -> None:
    _scatter(stretch, sign, count, low, high, trees=False)


def _scatter(stretch: Stretch, sign: int, count: int, low: float, high: float, trees: bool) -> None:
    rng, style = stretch.rng, stretch.style
    for _ in range(count):
        s, out = rng.uniform(stretch.start_m, stretch.stop_m), rng.uniform(max(low, 0.3), max(high, 0.5))
        if stretch.crosses(s, s):
            continue
        plant = stretch.library.draw_tree(rng, style) if trees else stretch.library.draw_bush(rng, style)
        mesh = plant.near if out < 14 else plant.far
        stretch.place_on_land(mesh, sign, s, out, -0.08, rng.uniform(0, 6.28), rng.uniform(0.7, 1.2))
