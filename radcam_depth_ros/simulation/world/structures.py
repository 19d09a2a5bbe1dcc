"""Builds bridges over the road, tunnels with their portals, and wires."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, quads, sheet
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch

_PORTAL_REACH_M = 60.0


def span_bridge(stretch: Stretch) -> None:
    """A bridge over the road with piers or walls beside it and a parapet."""
    style, rng = stretch.style, stretch.rng
    tone = rng.uniform(0.15, 0.5)
    concrete = Material(Surface.PAVING, Label.BUILDING, (tone, tone * 0.97, tone * 0.92), Texture.CONCRETE, 5.0)
    steel = Material(Surface.METAL, Label.FENCE, tuple(rng.uniform(0.05, 0.4, 3)), Texture.METAL, 2.0)
    clear, deep, wide = rng.uniform(4.6, 6.5), rng.uniform(0.7, 1.6), rng.uniform(4, 14)
    left, right = style.left_edge_m + style.left.land_m + 1.0, style.right_edge_m + style.right.land_m + 1.0
    reach = rng.uniform(6, 30)
    length, middle = left + right + 2 * reach, (left - right) / 2
    parts = [box([wide, length, deep], [0, middle, clear + deep / 2], concrete)]
    for x in (-wide / 2, wide / 2):
        parts.append(box([0.08, length, 0.12], [x, middle, clear + deep + 1.0], steel))
        posts = np.arange(-length / 2, length / 2, 2.0)
        parts += [box([0.06, 0.06, 1.0], [x, middle + float(y), clear + deep + 0.5], steel) for y in posts]
    solid = rng.random() < 0.5
    for y in (left + 0.5, -right - 0.5):
        if solid:
            parts.append(box([wide, 0.8, clear], [0, y, clear / 2], concrete))
        else:
            parts += [box([0.8, 0.8, clear], [x, y, clear / 2], concrete) for x in (-wide * 0.3, wide * 0.3)]
    if style.median_m > 1.5:
        parts.append(box([wide * 0.8, 0.7, clear], [0, 0, clear / 2], concrete))
    # The embankments that carry the crossing road on both sides.
    grass = Material(Surface.GROUND, Label.TERRAIN, style.grass, Texture.GRASS, 6.0)
    for sign, start in ((1, left), (-1, right)):
        reach_m = np.array([1.5, 6.0 + clear, 90.0])
        top = np.array([-0.5, clear + deep - 0.3, clear + deep - 0.3])
        rows = np.array([-wide / 2 - 9.0, -wide / 2 - 0.3, wide / 2 + 0.3, wide / 2 + 9.0])
        rise = np.array([0.0, 1.0, 1.0, 0.0])
        along, across = np.meshgrid(rows, sign * (start + reach_m), indexing="ij")
        z = rise[:, None] * (top + 0.5) - 0.5
        parts.append(sheet(np.stack([along, across, z], axis=-1), grass))
    stretch.place(join(parts), stretch.start_m + STRETCH_M * 0.5, 0.0, 0.0, rng.normal(0, 0.15))


def dig_tunnel(stretch: Stretch, opens_behind: bool, opens_ahead: bool) -> None:
    """Walls, ceiling and lamps over a stretch; portals and the hill's face where it opens."""
    style, rng = stretch.style, stretch.rng
    left = style.left_edge_m + (style.left.land_m if style.left.walk_m > 0 else 0.8)
    right = style.right_edge_m + (style.right.land_m if style.right.walk_m > 0 else 0.8)
    clear = 4.7 + 0.5 * float(style.lanes > 1)
    tone = style.tunnel
    wall = Material(Surface.PAVING, Label.WALL, (tone, tone * 0.97, tone * 0.9), Texture.CONCRETE, 4.0)
    tiles = Material(Surface.PAVING, Label.WALL, (min(1.0, tone * 1.6),) * 3, Texture.PAVING, 1.2)
    dark = Material(Surface.PAVING, Label.WALL, (tone * 0.5,) * 3, Texture.CONCRETE, 5.0)
    shoulder = Material(Surface.PAVING, Label.SIDEWALK, (tone, tone, tone), Texture.CONCRETE, 3.0)
    s = np.linspace(stretch.start_m, stretch.stop_m, 11)
    ones = np.ones((len(s), 1))
    for sign, at in ((1, left), (-1, right)):
        edge = stretch.side(sign)[1]
        stretch.grid(s, sign * np.array([edge, edge, at]), ones * np.array([0.0, 0.15, 0.15]), shoulder)
        stretch.grid(s, sign * np.array([at, at]), ones * np.array([0.0, 2.6]), tiles)
        stretch.grid(s, sign * np.array([at, at, at - 0.7]), ones * np.array([2.6, clear - 0.6, clear]), wall)
        if rng.random() < 0.3:
            # An emergency bay's door or a cabinet.
            door = Material(Surface.METAL, Label.WALL, tuple(rng.uniform(0.05, 0.6, 3)))
            stretch.place(box([2.0, 0.1, 2.2], [0, 0, 1.25], door), float(s[5]), sign * (at - 0.06))
    stretch.grid(s, np.array([-right + 0.7, 0.0, left - 0.7]), ones * np.array([clear, clear + 0.3, clear]), dark)
    glow = Material(Surface.LAMP, Label.WALL, (0.9, 0.85, 0.7))
    for at_s in np.arange(stretch.start_m + 3, stretch.stop_m, 10.0):
        for t in (-right * 0.45, left * 0.45):
            stretch.place(box([1.6, 0.25, 0.1], [0, 0, clear - 0.03], glow), float(at_s), t)
    hill = Material(Surface.GROUND, Label.TERRAIN, style.grass, Texture.GRASS, 6.0)
    stretch.grid(s, np.array([-90.0, -right, left, 90.0]), ones * np.array([9.0, clear + 3, clear + 3, 9.0]), hill)
    for opens, at_s in ((opens_behind, stretch.start_m), (opens_ahead, stretch.stop_m)):
        if not opens:
            continue
        ends = np.array([at_s, at_s + 0.01])
        for sign, at in ((1, left), (-1, right)):
            face = sign * np.array([at, at + _PORTAL_REACH_M])
            for low, high, look, out in ((-0.5, clear + 3.2, wall, 4.0), (-0.5, clear + 3.0, hill, _PORTAL_REACH_M)):
                reach = face if out > 10 else sign * np.array([at, at + out])
                columns = np.array([[low, low], [high, high]])
                shift = 0.0 if out > 10 else (-0.05 if at_s == stretch.start_m else 0.05)
                stretch.grid(ends + shift, reach, columns, look)
        stretch.grid(ends, np.array([-right, left]), np.array([[clear, clear], [clear + 3.2, clear + 3.2]]), wall)


def wires(length: float, height: float, count: int, sag: float) -> Mesh:
    """Wires along x from the origin on, side by side, that hang through in the middle."""
    black = Material(Surface.RUBBER, Label.WIRE, (0.03, 0.03, 0.03))
    x = np.linspace(0, length, 9)
    z = height - sag * 4 * (x / length) * (1 - x / length)
    faces = []
    for index in range(count):
        y, low = 0.5 * (index - (count - 1) / 2), np.stack([x, np.zeros_like(x), z], axis=-1)
        low[:, 1] = y
        high = low + np.array([0.0, 0.0, 0.03])
        faces.append(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1))
    return quads(np.concatenate(faces), black)
