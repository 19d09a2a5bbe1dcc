"""Furnishes the roadside: lamps, trees, signs, rails, parked vehicles, waiting and standing people."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects import furniture
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.settings.configuration import StreetKind
from radcam_depth_ros.simulation.settings.randomness import pick
from radcam_depth_ros.simulation.world.ground import side_road_height
from radcam_depth_ros.simulation.world.lots import lay_by
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch
from radcam_depth_ros.simulation.world.structures import span_bridge, wires
from radcam_depth_ros.simulation.world.works import heap


def furnish(stretch: Stretch) -> None:
    """Lamps, trees, signs, rails, parked vehicles and standing people of a stretch."""
    style, rng = stretch.style, stretch.rng
    if np.isfinite(stretch.crossing_m):
        _side_road_traffic(stretch)
    for sign in (1, -1):
        _parked(stretch, sign)
        _lamps(stretch, sign)
        _street_trees(stretch, sign)
        _signs(stretch, sign)
        _small_things(stretch, sign)
        _standing(stretch, sign)
        _snow_bank(stretch, sign)
        side, edge = stretch.side(sign)
        if side.guard_rail:
            for start, stop in stretch.spans:
                stretch.place_along(furniture.guard_rail, sign, start, stop, sign * (edge + 0.6))
        elif side.walk_m <= 0 and style.kind is not StreetKind.CAR_PARK and rng.random() < 0.06:
            lay_by(stretch, sign)
    crossed = np.isfinite(stretch.crossing_m)
    if style.kind is StreetKind.HIGHWAY and rng.random() < 0.12:
        span = style.right_edge_m + 2.0
        stretch.place(furniture.gantry(rng, span), stretch.start_m + 20.0, 0.0)
    elif not crossed and rng.random() < {StreetKind.HIGHWAY: 0.07, StreetKind.CAR_PARK: 0.0}.get(style.kind, 0.02):
        span_bridge(stretch)
    if style.has_wires:
        _wires(stretch)


def _side_road_traffic(stretch: Stretch) -> None:
    """Somebody who waits in the side road, and signals."""
    style, rng, half = stretch.style, stretch.rng, stretch.style.crossing_half_m
    moving = style.special is StreetKind.JUNCTION and style.waiting
    for sign in (1, -1):
        _, edge = stretch.side(sign)
        out = rng.uniform(2.5, 6.0)
        while not moving and out < 60 and rng.random() < 0.6:
            vehicle = stretch.library.draw_vehicle(rng, 0.15)
            out += vehicle.length_m / 2
            lift = float(side_road_height(stretch, sign, stretch.crossing_m, out))
            place = stretch.crossing_m - sign * half * 0.5
            stretch.place(vehicle.mesh, place, sign * (edge + out), lift, -sign * np.pi / 2)
            out += vehicle.length_m / 2 + rng.uniform(1.2, 4.0)
    lights = 1.0 if style.special is StreetKind.JUNCTION else 0.7
    if style.kind in (StreetKind.ARTERIAL, StreetKind.TOWN) and rng.random() < lights:
        reach_m = style.right_edge_m * pick(rng, (0.0, 0.6))
        near, beyond = stretch.crossing_m - half - 5.4, stretch.crossing_m + half + 2.4
        right, left = -(style.right_edge_m + 0.7), style.left_edge_m + 0.7
        stretch.place(furniture.traffic_light(rng, reach_m), near, right, 0.0, 0.0, (1.0, -1.0, 1.0))
        stretch.place(furniture.traffic_light(rng, 0.0), beyond, left, 0.0)
        if style.special is StreetKind.JUNCTION:
            stretch.place(furniture.traffic_light(rng, 0.0), beyond, right, 0.0, pick(rng, (0.0, np.pi / 2)))
            stretch.place(furniture.traffic_light(rng, 0.0), near, left, 0.0, -np.pi / 2)


def _snow_bank(stretch: Stretch, sign: int) -> None:
    """Ploughed snow along the edge, and heaps of it."""
    style, rng = stretch.style, stretch.rng
    if not style.snow or rng.random() < 0.5:
        return
    side, edge = stretch.side(sign)
    tone = rng.uniform(0.35, 0.9)
    look = Material(Surface.GROUND, Label.TERRAIN, (tone, tone, tone * 1.03), Texture.SNOW, rng.uniform(3, 8))
    at, lift = edge + side.parking_m + 0.1, style.kerb_m if side.walk_m > 0 else 0.0
    high, wide = rng.uniform(0.1, 0.55), rng.uniform(0.4, 1.2)
    for start, stop in stretch.spans:
        s = np.arange(start, stop + 0.9, 0.9).clip(start, stop)
        lumps = np.convolve(rng.standard_normal(len(s) + 2), [0.4, 0.5, 0.4], mode="valid")
        crest = high * np.exp(0.5 * lumps)
        crest[[0, -1]] *= 0.5
        foot = np.full(len(s), min(0.0, lift) - 0.02)
        t = sign * (at + np.array([0.0, 0.4 * wide, wide]))
        stretch.grid(s, t, np.stack([foot, lift + crest, foot + lift], axis=1), look)
    for _ in range(rng.poisson(0.4)):
        place, size = rng.uniform(stretch.start_m, stretch.stop_m), rng.uniform(0.6, 1.8)
        if not stretch.crosses(place, place):
            stretch.place(heap(rng, size, size * 0.6, look), place, sign * (edge + side.land_m + 0.8), lift)


def _wires(stretch: Stretch) -> None:
    """Wires along one side of the road, from stretch to stretch, and their masts."""
    style = stretch.style
    sign = 1 if style.lane_m > 3.0 else -1
    side, edge = stretch.side(sign)
    t, height = sign * (edge + side.land_m + 0.9), 7.5
    tone = style.asphalt
    mast = furniture.tube_pole(0.13, height + 0.6, (0.15 + 0.3 * tone, 0.13 + 0.3 * tone, 0.11 + 0.3 * tone))
    for start in (stretch.start_m, stretch.start_m + STRETCH_M / 2):
        z = float(stretch.ground_m(sign, start, 0.9)) - 0.1
        if not stretch.crosses(start, start):
            stretch.place(mast, start, t, z)
        stop = start + STRETCH_M / 2
        (x0, y0), (x1, y1) = stretch.path.position([start, stop], t)
        line = wires(float(np.hypot(x1 - x0, y1 - y0)), height, 3, 0.5)
        stretch.place(line, start, t, z, float(np.arctan2(y1 - y0, x1 - x0)) - float(stretch.path.heading(start)))


def _parked(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    if side.parking_m <= 0:
        return
    s = stretch.start_m + rng.uniform(0, 2)
    while s < stretch.stop_m - 5.0:
        car = stretch.library.draw_parked(rng, 0.10)
        length = car.length_m + rng.uniform(0.6, 2.0)
        if rng.random() < side.parked and not stretch.crosses(s, s + length) and s + length < stretch.stop_m + 2:
            turned = np.pi if (sign > 0) != (rng.random() < 0.12) else 0.0
            t = sign * (edge + side.parking_m / 2 + rng.normal(0, 0.08))
            stretch.place(car.mesh, s + length / 2, t, 0.0, turned + rng.normal(0, 0.015))
        s += length


def _lamps(stretch: Stretch, sign: int) -> None:
    style, rng = stretch.style, stretch.rng
    if style.kind is StreetKind.RURAL:
        if sign > 0 or rng.random() < 0.5:
            return
    elif rng.random() < 0.25:
        return
    side, edge = stretch.side(sign)
    item = furniture.pole(rng) if style.kind is StreetKind.RURAL else furniture.lamp(rng)
    pitch = rng.uniform(24, 45)
    t, z = sign * (edge + side.parking_m + 0.5), style.kerb_m * (side.walk_m > 0)
    for s in stretch.free_places(np.ceil(stretch.start_m / pitch) * pitch, stretch.stop_m, pitch):
        stretch.place(item, s, t, z, 0.0 if sign > 0 else np.pi)


def _street_trees(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    style, rng = stretch.style, stretch.rng
    if side.tree_spacing_m <= 0:
        return
    offset = (
        side.parking_m + (side.verge_m / 2 if side.verge_m > 0.3 else 0.8) if side.walk_m > 0 else rng.uniform(2.5, 5)
    )
    pitch = side.tree_spacing_m
    for s in np.arange(np.ceil(stretch.start_m / pitch) * pitch, stretch.stop_m, pitch):
        if rng.random() < 0.85 and not stretch.crosses(float(s), float(s)):
            plant = stretch.library.draw_tree(rng, style)
            z, place = float(stretch.ground_m(sign, s, offset - side.land_m)) - 0.03, float(s + rng.normal(0, 0.4))
            turn, scale = rng.uniform(0, 6.28), rng.uniform(0.75, 1.15)
            stretch.place(plant.near, place, sign * (edge + offset), z, turn, scale)


def _signs(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    for _ in range(rng.poisson({StreetKind.TOWN: 1.2, StreetKind.HIGHWAY: 0.5}.get(stretch.style.kind, 0.8))):
        s = rng.uniform(stretch.start_m, stretch.stop_m)
        large = rng.random() < 0.2
        item = furniture.board(rng) if large else furniture.traffic_sign(rng)
        offset = side.parking_m + (0.45 if side.walk_m > 0 and not large else rng.uniform(1.2, 2.5))
        z = float(stretch.ground_m(sign, s, offset - side.land_m))
        stretch.place(item, s, sign * (edge + offset), z, (0.0 if sign < 0 else np.pi) + rng.normal(0, 0.08))


def _small_things(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    style, rng = stretch.style, stretch.rng
    if side.walk_m <= 0:
        if rng.random() < 0.4:
            post = furniture.bollard(rng)
            for s in np.arange(stretch.start_m, stretch.stop_m, 25.0):
                stretch.place(post, float(s), sign * (edge + 0.9), 0.0)
        return
    lift = style.kerb_m
    if rng.random() < 0.15:
        post = furniture.bollard(rng)
        for s in stretch.free_places(stretch.start_m, stretch.stop_m, rng.uniform(1.6, 4)):
            stretch.place(post, s, sign * (edge + side.parking_m + 0.35), lift)
    items: list[Mesh] = [furniture.litter_bin(rng) for _ in range(rng.poisson(1.0))]
    if rng.random() < 0.4:
        items += [stretch.library.bicycles[index % 2] for index in range(int(rng.integers(1, 5)))]
    spot = rng.uniform(stretch.start_m + 2, stretch.stop_m - 8)
    for index, item in enumerate(items):
        s = spot + 0.9 * index
        if not stretch.crosses(s, s):
            stretch.place(item, s, sign * (edge + side.land_m - 0.4), lift, np.pi / 2 + rng.normal(0, 0.1))
    if rng.random() < 0.06 and not stretch.crosses(spot + 3, spot + 9):
        stretch.place(
            furniture.shelter(rng), spot + 6, sign * (edge + side.parking_m + 1.2), lift, 0.0 if sign > 0 else np.pi
        )


def _standing(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    count = rng.poisson(stretch.people * stretch.style.people_per_100m * STRETCH_M / 100 * 0.4)
    for _ in range(count if side.walk_m > 0 else 0):
        s = rng.uniform(stretch.start_m, stretch.stop_m)
        t = sign * (edge + side.parking_m + rng.uniform(0.4, max(side.walk_m - 0.3, 0.5)) + side.verge_m)
        pose = pick(rng, stretch.library.walkers)[0]
        yaw = rng.uniform(0, 6.28)
        stretch.place(pose, s, t, stretch.style.kerb_m, yaw)
        # Some talk to each other.
        for _ in range(pick(rng, (0, 1, 2, 3), (0.7, 0.18, 0.08, 0.04))):
            other = pick(rng, stretch.library.walkers)[0]
            aside = rng.uniform(-1.0, 1.0, 2)
            stretch.place(other, s + float(aside[0]), t + float(aside[1]) * 0.5, stretch.style.kerb_m, yaw + np.pi)
