"""Builds open places: car parks with rows of vehicles, yards, squares, lay-bys, driveways."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects import buildings, furniture
from radcam_depth_ros.simulation.settings.configuration import StreetKind
from radcam_depth_ros.simulation.settings.randomness import log_uniform, pick
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch

_BAY_M, _ROW_M = 2.5, 5.0


def fill_lot(stretch: Stretch, sign: int) -> None:
    """Rows of bays beside the road, with vehicles in some of them."""
    style, rng = stretch.style, stretch.rng
    side, edge = stretch.side(sign)
    first = side.land_m + (0.3 if style.kind is StreetKind.CAR_PARK else rng.uniform(2, 6))
    rows = int(rng.integers(1, 7))
    taken = rng.uniform(0.05, 0.95) * float(side.parked > 0)
    lines = (
        Material(Surface.PAINT_MARK, Label.ROAD, (0.5, 0.5, 0.48), Texture.MARK, 2.5) if rng.random() < 0.7 else None
    )
    slant = pick(rng, (0.0, 0.0, 0.35))
    out = first
    for row in range(rows):
        _row(stretch, sign, out, taken, slant, lines)
        # Two rows back to back, then an aisle.
        out += _ROW_M + (rng.uniform(5.5, 8.0) if row % 2 == 0 else 0.3)
    if rng.random() < 0.5:
        item = furniture.lamp(rng)
        for s in stretch.free_places(stretch.start_m + 5, stretch.stop_m, 22.0):
            stretch.place(item, s, sign * (edge + first + _ROW_M + 0.2), 0.0, 0.0 if sign > 0 else np.pi)
    if rng.random() < 0.3:
        low = rng.uniform(stretch.start_m, stretch.stop_m - 8)
        if not stretch.crosses(low, low + 5):
            stretch.place(furniture.shelter(rng), low + 2.5, sign * (edge + first + _ROW_M + 1.0), 0.0)
    _close(stretch, sign, out + 2.0)


def fill_open(stretch: Stretch, sign: int) -> None:
    """A wide empty surface, with little on it."""
    style, rng = stretch.style, stretch.rng
    for _ in range(rng.poisson(1.2)):
        s, out = rng.uniform(stretch.start_m, stretch.stop_m), rng.uniform(4, 50)
        if stretch.crosses(s - 4, s + 4):
            continue
        kind = int(rng.integers(4))
        if kind < 2:
            item = stretch.library.draw_parked(rng, 0.4).mesh
        else:
            item = furniture.lamp(rng) if kind == 2 else furniture.litter_bin(rng)
        stretch.place_on_land(item, sign, s, out, -0.02, rng.uniform(0, 6.28))
    if rng.random() < 0.3 and style.kind is not StreetKind.CAR_PARK:
        fence = partial(furniture.wire_fence, height=rng.uniform(1.0, 2.2))
        for start, stop in stretch.spans:
            stretch.place_along_land(fence, sign, start, stop, 0.6, -0.03)
    _close(stretch, sign, rng.uniform(30, 70))


def _row(stretch: Stretch, sign: int, out: float, taken: float, slant: float, lines: Material | None) -> None:
    rng = stretch.rng
    side, edge = stretch.side(sign)
    if out + _ROW_M > 80:
        return
    for s in np.arange(np.ceil(stretch.start_m / _BAY_M) * _BAY_M, stretch.stop_m, _BAY_M):
        at = float(s)
        if stretch.crosses(at - 1, at + _BAY_M):
            continue
        z = float(stretch.ground_m(sign, at, out + _ROW_M / 2 - side.land_m)) - 0.02
        if lines is not None:
            stretch.strip(sign * (edge + out), sign * (edge + out + _ROW_M), z + 0.012, lines, at - 0.05, at + 0.05)
        if rng.random() < taken:
            vehicle = stretch.library.draw_parked(rng, 0.03)
            if vehicle.length_m > 6.5:
                continue
            turn = pick(rng, (-1.0, 1.0)) * np.pi / 2 + sign * slant + rng.normal(0, 0.03)
            reach = out + _ROW_M / 2 + rng.normal(0, 0.15)
            stretch.place(vehicle.mesh, at + _BAY_M / 2 + rng.normal(0, 0.08), sign * (edge + reach), z, turn)


def _close(stretch: Stretch, sign: int, out: float) -> None:
    """Closes an open place with a hall, trees or nothing."""
    rng = stretch.rng
    side, _ = stretch.side(sign)
    kind = rng.random()
    if kind < 0.35 and not np.isfinite(stretch.crossing_m) and out < 60:
        length = rng.uniform(25, STRETCH_M - 1)
        hall = buildings.hall(rng, length, rng.uniform(15, 35), rng.uniform(4, 11))
        start = stretch.start_m if sign > 0 else stretch.start_m + length
        stretch.place_facing_road(hall, sign, start, side.land_m + out, 15.0)
    elif kind < 0.75:
        for s in np.arange(stretch.start_m, stretch.stop_m, rng.uniform(4, 12)):
            plant = stretch.library.draw_tree(rng, stretch.style)
            at = min(out + rng.normal(0, 1.5), 85.0)
            stretch.place_on_land(plant.far, sign, float(s), at, -0.1, rng.uniform(0, 6.28))


def lay_driveways(stretch: Stretch, sign: int) -> None:
    """Paved ways from the road to the houses, some with a car on them."""
    rng = stretch.rng
    side, edge = stretch.side(sign)
    for _ in range(rng.poisson(1.3)):
        s, wide = rng.uniform(stretch.start_m + 2, stretch.stop_m - 5), rng.uniform(2.6, 5.5)
        if stretch.crosses(s, s + wide):
            continue
        tone = log_uniform(rng, 0.05, 0.45)
        texture = pick(rng, (Texture.PAVING, Texture.COBBLES, Texture.ASPHALT, Texture.GRAVEL))
        look = Material(Surface.PAVING, Label.ROAD, (tone * 1.03, tone, tone * 0.94), texture, rng.uniform(1, 4))
        start = side.parking_m if side.walk_m > 0 else -0.2
        reach = np.array([start, start + 0.6, side.land_m, side.land_m + 4.0, side.land_m + 9.0])
        along, outwards = np.meshgrid(np.array([s, s + wide]), reach, indexing="ij")
        z = stretch.ground_m(sign, along, outwards - side.land_m, ditch=False) + 0.035
        z[:, 0] = 0.006
        stretch.grid(along[:, 0], sign * (edge + reach), z, look)
        if rng.random() < 0.5 * float(side.parked > 0):
            vehicle = stretch.library.draw_parked(rng)
            out = side.land_m + rng.uniform(2.4, 5.0)
            lift = float(stretch.ground_m(sign, s, out - side.land_m, ditch=False)) + 0.035
            turn = pick(rng, (-1.0, 1.0)) * np.pi / 2
            stretch.place(vehicle.mesh, s + wide / 2, sign * (edge + out), lift, turn)


def lay_by(stretch: Stretch, sign: int) -> None:
    """A widening of the road with somebody who rests there."""
    style, rng = stretch.style, stretch.rng
    _, edge = stretch.side(sign)
    low, wide = stretch.start_m + rng.uniform(0, 10), rng.uniform(2.8, 4.0)
    high = low + rng.uniform(22, 38)
    if stretch.crosses(low, high):
        return
    tone = style.asphalt * rng.uniform(0.7, 1.4)
    look = Material(Surface.ASPHALT, Label.ROAD, (tone, tone, tone), style.road, style.road_tile_m)
    s, widths = [low - 6.0, low, high, high + 6.0], [0.1, wide, wide, 0.1]
    for ends, across in zip(pairwise(s), pairwise(widths), strict=True):
        for (a, b), (wa, wb) in zip(pairwise(np.linspace(*ends, 3)), pairwise(np.linspace(*across, 3)), strict=True):
            stretch.strip(sign * (edge - 0.05), sign * (edge + (wa + wb) / 2), 0.02, look, float(a), float(b))
    if rng.integers(0, 3):
        vehicle = stretch.library.draw_parked(rng, 0.6)
        place = rng.uniform(low + 8, high - 8)
        stretch.place(vehicle.mesh, place, sign * (edge + wide / 2), 0.02, 0.0 if sign < 0 else np.pi)
