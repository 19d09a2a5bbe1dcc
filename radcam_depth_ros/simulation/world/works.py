"""Builds construction sites: cones, beacons, barriers, fences, containers, machines, heaps."""

from __future__ import annotations

from functools import partial

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects import furniture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, sheet, tube
from radcam_depth_ros.simulation.settings.randomness import pick
from radcam_depth_ros.simulation.world.street import Stretch

_ORANGE = (0.75, 0.16, 0.02)
_YELLOW = (0.65, 0.36, 0.02)


def cone() -> Mesh:
    """A traffic cone."""
    rubber = Material(Surface.RUBBER, Label.IGNORE, _ORANGE)
    band = Material(Surface.SIGN_FACE, Label.IGNORE, (0.8, 0.8, 0.8))
    body = tube(0.14, 0.72, rubber, 8, 0.03)
    foot = box([0.4, 0.4, 0.04], [0, 0, 0.02], rubber)
    return join([foot, body, tube(0.103, 0.14, band, 8, 0.082).moved((0, 0, 0.28))])


def beacon() -> Mesh:
    """A striped board on a foot, facing -x."""
    stripes = Material(Surface.SIGN_FACE, Label.IGNORE, (0.85, 0.12, 0.08), Texture.STRIPES, 0.6)
    foot = Material(Surface.RUBBER, Label.IGNORE, (0.04, 0.04, 0.04))
    lamp = Material(Surface.LAMP, Label.IGNORE, (0.9, 0.5, 0.05))
    return join(
        [
            box([0.05, 0.25, 1.0], [0, 0, 0.75], stripes),
            box([0.8, 0.4, 0.12], [0, 0, 0.06], foot),
            box([0.1, 0.18, 0.2], [0, 0, 1.36], lamp),
        ]
    )


def barrier(length: float) -> Mesh:
    """A striped barrier along x."""
    stripes = Material(Surface.SIGN_FACE, Label.FENCE, (0.85, 0.12, 0.08), Texture.STRIPES, 1.0)
    foot = Material(Surface.RUBBER, Label.FENCE, (0.05, 0.05, 0.05))
    feet = [box([0.3, 0.8, 0.1], [x, 0, 0.05], foot) for x in (0.2, length - 0.2)]
    rails = [box([length * 0.96, 0.04, 0.22], [length / 2, 0, z], stripes) for z in (0.35, 1.0)]
    posts = [box([0.05, 0.05, 1.1], [x, 0, 0.55], foot) for x in (0.1, length - 0.1)]
    return join([*feet, *rails, *posts])


def container(rng: np.random.Generator) -> Mesh:
    """A steel container, a skip or a site office, along x."""
    colour = tuple(rng.uniform(0.03, 0.5, 3))
    steel = Material(Surface.METAL, Label.IGNORE, colour, Texture.PLANKS, 1.6)
    if rng.random() < 0.4:
        dirt = Material(Surface.GROUND, Label.IGNORE, (0.2, 0.15, 0.1), Texture.GRAVEL, 1.5)
        return join([box([3.4, 1.8, 1.4], [0, 0, 0.8], steel, (1.25, 1.0)), box([3.6, 1.6, 0.3], [0, 0, 1.45], dirt)])
    length = pick(rng, (3.0, 6.06))
    glass = Material(Surface.GLASS, Label.IGNORE, (0.03, 0.035, 0.04))
    pane = [box([1.0, 0.04, 0.9], [0.4, y, 1.6], glass) for y in (-1.22, 1.22)] if rng.random() < 0.5 else []
    return join([box([length, 2.44, 2.6], [0, 0, 1.36], steel), *pane])


def excavator(rng: np.random.Generator) -> Mesh:
    """A digger on tracks with its arm in some pose, along x."""
    label = Label.TRUCK
    colours = (_YELLOW, _ORANGE, (0.5, 0.5, 0.48), (0.1, 0.3, 0.12))
    paint = Material(Surface.BODYWORK, label, pick(rng, colours))
    black = Material(Surface.RUBBER, label, (0.03, 0.03, 0.03))
    glass = Material(Surface.GLASS, label, (0.03, 0.035, 0.04))
    tracks = [box([3.6, 0.55, 0.85], [0, y, 0.43], black, (0.85, 1.0)) for y in (-1.0, 1.0)]
    lift, fold = rng.uniform(0.3, 1.0), rng.uniform(0.6, 1.6)
    # A beam along x from its origin, turned upwards by an angle; swung() turns about y.
    first = box([3.4, 0.35, 0.45], [1.7, 0, 0], paint).swung(lift, 0.0)
    tip = np.array([3.4 * np.cos(lift), 0.0, 3.4 * np.sin(lift)])
    second = box([2.4, 0.28, 0.34], [1.2, 0, 0], paint).swung(lift - fold, 0.0)
    end = tip + 2.4 * np.array([np.cos(lift - fold), 0.0, np.sin(lift - fold)])
    base = np.array([1.0, 0.35, 1.6])
    bucket = box([0.8, 1.1, 0.8], [0, 0, 0], black, (0.6, 1.0))
    upper = join(
        [
            box([2.9, 2.3, 1.0], [-0.6, 0, 1.55], paint),
            box([1.4, 0.95, 1.3], [0.4, 0.65, 2.6], glass),
            box([1.45, 1.0, 0.1], [0.4, 0.65, 3.28], paint),
            first.moved(base.tolist()),
            second.moved((base + tip).tolist()),
            bucket.moved((base + end).tolist()),
        ]
    )
    return join([*tracks, upper.moved((0, 0, 0), rng.uniform(0, 6.28))])


def heap(rng: np.random.Generator, radius: float, height: float, material: Material) -> Mesh:
    """A heap of something loose on the origin."""
    angle = np.linspace(0, 2 * np.pi, 13)
    share = np.linspace(0, 1, 5)
    wobble = rng.uniform(0.75, 1.2, 12)
    wobble = np.append(wobble, wobble[0])
    distance = radius * (1 - share)[:, None] * wobble
    z = height * (1 - (1 - share) ** 2)[:, None] * np.ones(13) - 0.05
    points = np.stack([distance * np.cos(angle), distance * np.sin(angle), z], axis=-1)
    return sheet(points, material)


def set_up_works(stretch: Stretch) -> None:
    """Closes the outermost own lane, or what lies beside the road, over a stretch."""
    style, rng = stretch.style, stretch.rng
    closed = style.closed_lanes
    line = -(style.median_m / 2 + style.open_lanes * style.lane_m + 0.3)
    sign = -1 if closed or rng.random() < 0.6 else 1
    if sign > 0:
        line = style.left_edge_m + 0.4
    _guide(stretch, line)
    if rng.random() < 0.35:
        _guide(stretch, line + sign * 0.8)
    side, edge = stretch.side(sign)
    inner, outer = abs(line) + 0.6, edge + side.land_m + rng.uniform(3, 9)
    if rng.random() < 0.6:
        colour = pick(rng, ((0.2, 0.14, 0.09), (0.35, 0.3, 0.22), (0.25, 0.24, 0.22)))
        texture = pick(rng, (Texture.SOIL, Texture.GRAVEL))
        soil = Material(Surface.GROUND, Label.TERRAIN, colour, texture, rng.uniform(2, 5))
        low, high = sorted(rng.uniform(stretch.start_m, stretch.stop_m, 2))
        stretch.strip(sign * inner, sign * min(edge + 0.2, outer), 0.02, soil, float(low), float(high) + 1.0)
        for _ in range(rng.poisson(0.9)):
            size = rng.uniform(1.0, 2.6)
            s = rng.uniform(stretch.start_m, stretch.stop_m)
            stretch.place(heap(rng, size, size * 0.55, soil), s, sign * (outer + size * 0.3), 0.0)
    for _ in range(rng.poisson(1.0)):
        item = excavator(rng) if rng.random() < 0.4 else container(rng)
        s, yaw = rng.uniform(stretch.start_m, stretch.stop_m), rng.normal(0, 0.2)
        if not stretch.crosses(s - 3, s + 3):
            out = rng.uniform(inner + 2.2, max(outer, inner + 2.4))
            stretch.place(item, s, sign * out, style.kerb_m if out > edge and side.walk_m > 0 else 0.0, yaw)
    if rng.random() < 0.5:
        low = rng.uniform(stretch.start_m, stretch.stop_m - 15)
        fence = partial(furniture.wire_fence, height=2.0)
        stretch.place_along(fence, -sign, low, low + 14.0, sign * (outer + 0.5))
    if rng.random() < 0.4:
        board = furniture.board(rng)
        stretch.place(board.recoloured(Surface.SIGN_FACE, _YELLOW), stretch.start_m + 5.0, -(style.right_edge_m + 1.2))


def _guide(stretch: Stretch, line: float) -> None:
    """A row of cones, beacons, barriers or mobile walls at an offset from the centre line."""
    rng = stretch.rng
    kind = int(rng.integers(4))
    if kind == 3:
        for start, stop in stretch.spans:
            stretch.place_along(furniture.concrete_barrier if rng.random() < 0.5 else barrier, 1, start, stop, line)
        return
    item = (cone(), beacon(), barrier(2.0))[kind]
    for s in stretch.free_places(stretch.start_m, stretch.stop_m, rng.uniform(3.0, 9.0)):
        turn = rng.normal(0, 0.1) if kind < 2 else rng.normal(0, 0.2)
        stretch.place(item, s, line + rng.normal(0, 0.12), 0.0, turn)
