"""Large vehicles: vans, trucks, buses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, pane, prism, quads
from radcam_depth_ros.simulation.objects.vehicle_parts import Vehicle, glass, lamps, wheels
from radcam_depth_ros.simulation.settings.randomness import pick


def build_van(rng: np.random.Generator) -> Vehicle:
    """A delivery van or minibus."""
    label = Label.CAR if rng.random() < 0.6 else Label.TRUCK
    body = Material(Surface.BODYWORK, label, (0.7, 0.7, 0.7))
    length, width, height = (float(rng.uniform(*bounds)) for bounds in ((4.8, 6.2), (1.9, 2.05), (1.95, 2.65)))
    front, rear, low = length / 2, -length / 2, 0.3
    nose = rng.uniform(1.05, 1.2)
    screen = front - rng.uniform(0.5, 0.9)
    profile = [
        (rear, low),
        (front - 0.1, low),
        (front, low + 0.3),
        (front - 0.04, nose - 0.1),
        (screen, nose + 0.1),
        (screen - 0.75, height - 0.1),
        (screen - 1.1, height),
        (rear + 0.12, height),
        (rear, height - 0.1),
    ]
    panes = [pane((screen + 0.03, width * 0.44, nose + 0.12), (screen - 0.70, width * 0.40, height - 0.14))]
    rows = [(screen - 0.25, screen - 1.25)]
    if rng.random() < 0.6:
        rows += [(screen - 1.45, screen - 2.6), (screen - 2.75, rear + 0.3)]
    base, peak = width * 0.493 + 0.01, width * 0.462 + 0.012
    panes += [
        [
            (begin, side * base, nose + 0.15),
            (stop, side * base, nose + 0.15),
            (stop, side * peak, height * 0.85),
            (begin - 0.35 * (begin > screen - 1), side * peak, height * 0.85),
        ]
        for begin, stop in rows
        for side in (-1, 1)
    ]
    if rng.random() < 0.7:
        panes.append(pane((rear - 0.012, width * 0.4, nose + 0.2), (rear - 0.012, width * 0.38, height * 0.86)))
    parts = [prism(profile, width, body, width * 0.92, bulge=0.06, flank=Texture.LIVERY_0), quads(panes, glass(label))]
    parts += lamps(label, front, rear, width / 2, 0.85, 1.4)
    aside = width / 2 + 0.1
    parts += [box([0.12, 0.18, 0.3], [screen - 0.1, y, nose + 0.3], glass(label)) for y in (-aside, aside)]
    parts += wheels(label, (-length * 0.29, length * 0.31), width, 0.34)
    return Vehicle(join(parts), length)


def build_truck(rng: np.random.Generator, articulated: bool) -> Vehicle:
    """A truck with a box body, or an articulated one."""
    label = Label.TRUCK
    cab_paint = Material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    load = float(rng.uniform(11, 13.6) if articulated else rng.uniform(4.5, 7.5))
    width, height = 2.5, float(rng.uniform(3.3, 4.0) if articulated else rng.uniform(2.8, 3.6))
    cab = 2.2
    length = load + cab + 0.4
    front, rear = length / 2, -length / 2
    tone = [(0.75, 0.75, 0.72), (0.55, 0.56, 0.55), (0.05, 0.12, 0.32), (0.35, 0.04, 0.03), (0.08, 0.22, 0.1)]
    colour = pick(rng, tone, (0.45, 0.2, 0.15, 0.1, 0.1))
    texture = Texture.SIGN if rng.random() < 0.4 and max(colour) > 0.5 else Texture.METAL
    canvas = Material(Surface.CANVAS, label, colour, texture, 2.6)
    frame = Material(Surface.METAL, label, (0.05, 0.05, 0.055))
    cab_high = min(height - 0.1, rng.uniform(2.6, 3.4))
    profile = [
        (front - cab, 0.5),
        (front - 0.08, 0.4),
        (front, 0.6),
        (front - 0.05, 1.5),
        (front - 0.35, cab_high - 0.1),
        (front - 0.6, cab_high),
        (front - cab, cab_high),
    ]
    screen = pane((front - 0.04, 1.05, 1.6), (front - 0.28, 1.0, cab_high - 0.45))
    doors = [
        [
            (front - 0.4, side * 1.215, 1.55),
            (front - 1.3, side * 1.215, 1.55),
            (front - 1.3, side * 1.205, 2.25),
            (front - 0.55, side * 1.205, 2.25),
        ]
        for side in (-1, 1)
    ]
    parts = [
        _load([load, width, height - 1.05], [rear + load / 2, 0, (height + 1.05) / 2], canvas),
        box([length - 0.6, 0.9, 0.3], [-0.1, 0, 0.8], frame),
        box([0.12, 2.3, 0.12], [rear + 0.15, 0, 0.55], frame),
        prism(profile, 2.42, cab_paint, 2.34, bulge=0.08),
        quads([screen, *doors], glass(label)),
    ]
    parts += lamps(label, front, rear, 1.2, 0.85, 1.1)
    tractor, trailer = ((front - 4.2,), (rear + 4.0,)) if articulated else ((), ())
    parts += wheels(label, (front - 1.3, *tractor, rear + 1.4, rear + 2.7, *trailer), width, 0.5)
    return Vehicle(join(parts), length)


def _load(size: list[float], centre: list[float], canvas: Material) -> Mesh:
    """A box body whose flanks and back are marked for lettering, upright, a tile for each."""
    body = box(size, centre, canvas)
    texture, uv = body.texture.copy(), body.uv.copy()
    # The faces of a box: right, front, left, back, each of two triangles.
    for first, length in ((0, size[0]), (4, size[0]), (6, size[1])):
        faces = slice(first, first + 2)
        texture[faces] = Texture.LIVERY_0
        uv[faces] *= np.array([canvas.tile_m / length, -canvas.tile_m / size[2]], np.float32)
        uv[faces, :, 1] += 1
    return replace(body, texture=texture, uv=uv)


def build_bus(rng: np.random.Generator) -> Vehicle:
    """A city bus."""
    label = Label.BUS
    body = Material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    length, width, height = rng.uniform(10.5, 12.2), 2.5, rng.uniform(2.9, 3.2)
    front, rear = length / 2, -length / 2
    profile = [
        (rear, 0.35),
        (front - 0.05, 0.35),
        (front, 0.7),
        (front - 0.02, 1.2),
        (front - 0.18, height - 0.15),
        (front - 0.4, height),
        (rear + 0.1, height),
        (rear, height - 0.15),
    ]
    panes = [
        [(x, side * 1.262, 1.15), (x + 1.5, side * 1.262, 1.15), (x + 1.5, side * 1.245, 2.5), (x, side * 1.245, 2.5)]
        for side in (-1, 1)
        for x in np.arange(rear + 0.3, front - 1.8, 1.6)
    ]
    panes.append(pane((front + 0.0, 1.15, 0.95), (front - 0.11, 1.12, 2.6)))
    panes.append(pane((rear - 0.012, 1.0, 1.5), (rear - 0.012, 1.0, 2.4)))
    display = Material(Surface.LAMP, label, (0.6, 0.35, 0.02))
    parts = [prism(profile, width, body, width * 0.985, flank=Texture.LIVERY_0), quads(panes, glass(label))]
    parts.append(box([0.06, 1.4, 0.25], [front - 0.12, 0, height - 0.28], display))
    parts += lamps(label, front, rear, 1.2, 0.75, 1.3)
    parts += wheels(label, (front - 2.7, rear + 3.2), width, 0.48)
    return Vehicle(join(parts), length)
