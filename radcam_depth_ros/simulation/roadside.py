"""What stands, parks and waits between the road and the land behind it."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation import furniture
from radcam_depth_ros.simulation.configuration import StreetKind
from radcam_depth_ros.simulation.mesh import Mesh
from radcam_depth_ros.simulation.street import STRETCH_M, Stretch
from radcam_depth_ros.simulation.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.vehicles import with_lamps_off


def furnish(stretch: Stretch) -> None:
    """Lamps, trees, signs, rails, parked vehicles and standing people of a stretch."""
    lay_side_road(stretch)
    for sign in (1, -1):
        _parked(stretch, sign)
        _lamps(stretch, sign)
        _street_trees(stretch, sign)
        _signs(stretch, sign)
        _small_things(stretch, sign)
        _standing(stretch, sign)
        side, edge = stretch.side(sign)
        if side.guard_rail:
            at, turn = (stretch.start_m, 0.0) if sign > 0 else (stretch.stop_m, np.pi)
            stretch.place(furniture.guard_rail(STRETCH_M), at, sign * (edge + 0.6), 0.0, turn)
    if stretch.style.kind is StreetKind.HIGHWAY and stretch.rng.random() < 0.12:
        span = stretch.style.right_edge_m + 2.0
        stretch.place(furniture.gantry(stretch.rng, span), stretch.start_m + 20.0, 0.0)


def lay_side_road(stretch: Stretch) -> None:
    """A side road over kerb and land on both sides, with somebody waiting in it."""
    if not np.isfinite(stretch.crossing_m):
        return
    style, rng = stretch.style, stretch.rng
    tone = style.asphalt * float(rng.uniform(0.8, 1.2))
    road = Material(Surface.ASPHALT, Label.ROAD, (tone, tone, tone), Texture.ASPHALT, 6.0)
    for sign in (1, -1):
        side, edge = stretch.side(sign)
        reach = np.array([0.0, 0.5, 6.0, 20.0, 45.0, 80.0])
        s = stretch.crossing_m + np.array([-3.6, 0.0, 3.6])
        along, outwards = np.meshgrid(s, reach, indexing="ij")
        z = stretch.ground_m(sign, along, outwards - side.land_m) + 0.09
        z[:, 0] = 0.003
        stretch.grid(s, sign * (edge + reach), z, road)
        if rng.random() < 0.6:
            car = stretch.library.draw_vehicle(rng, 0.15)
            out = float(rng.uniform(3.5, 7)) + car.length_m / 2
            lift = float(stretch.ground_m(sign, stretch.crossing_m, out - side.land_m)) + 0.09
            stretch.place(car.mesh, stretch.crossing_m - sign * 1.8, sign * (edge + out), lift, -sign * np.pi / 2)
    if style.kind in (StreetKind.ARTERIAL, StreetKind.TOWN) and rng.random() < 0.7:
        reach_m = style.right_edge_m * float(rng.choice([0.0, 0.6]))
        signal = furniture.traffic_light(rng, reach_m)
        stretch.place(signal, stretch.crossing_m - 9.0, -(style.right_edge_m + 0.7), 0.0, 0.0, (1.0, -1.0, 1.0))
        stretch.place(furniture.traffic_light(rng, 0.0), stretch.crossing_m + 6.0, style.left_edge_m + 0.7, 0.0)


def _parked(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    if side.parking_m <= 0:
        return
    s = stretch.start_m + float(rng.uniform(0, 2))
    while s < stretch.stop_m - 5.0:
        car = stretch.library.draw_vehicle(rng, 0.10)
        length = car.length_m + float(rng.uniform(0.6, 2.0))
        if rng.random() < side.parked and not stretch.crosses(s, s + length) and s + length < stretch.stop_m + 2:
            turned = np.pi if (sign > 0) != (rng.random() < 0.12) else 0.0
            t = sign * (edge + side.parking_m / 2 + float(rng.normal(0, 0.08)))
            stretch.place(with_lamps_off(car.mesh), s + length / 2, t, 0.0, turned + float(rng.normal(0, 0.015)))
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
    pitch = float(rng.uniform(24, 45))
    for s in np.arange(np.ceil(stretch.start_m / pitch) * pitch, stretch.stop_m, pitch):
        if not stretch.crosses(float(s), float(s)):
            stretch.place(
                item,
                float(s),
                sign * (edge + side.parking_m + 0.5),
                style.kerb_m * (side.walk_m > 0),
                0.0 if sign > 0 else np.pi,
            )


def _street_trees(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    style, rng = stretch.style, stretch.rng
    if side.tree_spacing_m <= 0:
        return
    offset = (
        side.parking_m + (side.verge_m / 2 if side.verge_m > 0.3 else 0.8)
        if side.walk_m > 0
        else float(rng.uniform(2.5, 5))
    )
    for s in np.arange(
        np.ceil(stretch.start_m / side.tree_spacing_m) * side.tree_spacing_m, stretch.stop_m, side.tree_spacing_m
    ):
        if rng.random() < 0.85 and not stretch.crosses(float(s), float(s)):
            plant = stretch.library.draw_tree(rng, style)
            z = float(stretch.ground_m(sign, s, offset - side.land_m)) - 0.03
            stretch.place(
                plant.near,
                float(s + rng.normal(0, 0.4)),
                sign * (edge + offset),
                z,
                rng.uniform(0, 6.28),
                rng.uniform(0.75, 1.15),
            )


def _signs(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    count = int(rng.poisson({StreetKind.TOWN: 1.2, StreetKind.HIGHWAY: 0.5}.get(stretch.style.kind, 0.8)))
    for _ in range(count):
        s = float(rng.uniform(stretch.start_m, stretch.stop_m))
        large = rng.random() < 0.2
        item = furniture.board(rng) if large else furniture.traffic_sign(rng)
        offset = side.parking_m + (0.45 if side.walk_m > 0 and not large else float(rng.uniform(1.2, 2.5)))
        z = float(stretch.ground_m(sign, s, offset - side.land_m))
        stretch.place(item, s, sign * (edge + offset), z, (0.0 if sign < 0 else np.pi) + float(rng.normal(0, 0.08)))


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
        for s in np.arange(stretch.start_m, stretch.stop_m, rng.uniform(1.6, 4)):
            if not stretch.crosses(float(s), float(s)):
                stretch.place(post, float(s), sign * (edge + side.parking_m + 0.35), lift)
    items: list[Mesh] = [furniture.litter_bin(rng) for _ in range(int(rng.poisson(1.0)))]
    if rng.random() < 0.4:
        items += [stretch.library.bicycles[index % 2] for index in range(int(rng.integers(1, 5)))]
    spot = float(rng.uniform(stretch.start_m + 2, stretch.stop_m - 8))
    for index, item in enumerate(items):
        s = spot + 0.9 * index
        if not stretch.crosses(s, s):
            stretch.place(item, s, sign * (edge + side.land_m - 0.4), lift, np.pi / 2 + float(rng.normal(0, 0.1)))
    if rng.random() < 0.06:
        stretch.place(
            furniture.shelter(rng), spot + 6, sign * (edge + side.parking_m + 1.2), lift, 0.0 if sign > 0 else np.pi
        )


def _standing(stretch: Stretch, sign: int) -> None:
    side, edge = stretch.side(sign)
    rng = stretch.rng
    count = int(rng.poisson(stretch.people * stretch.style.people_per_100m * STRETCH_M / 100 * 0.4))
    for _ in range(count if side.walk_m > 0 else 0):
        s = float(rng.uniform(stretch.start_m, stretch.stop_m))
        t = sign * (edge + side.parking_m + float(rng.uniform(0.4, max(side.walk_m - 0.3, 0.5))) + side.verge_m)
        pose = stretch.library.draw_walker(rng).poses[0]
        stretch.place(pose, s, t, stretch.style.kerb_m, float(rng.uniform(0, 6.28)))
