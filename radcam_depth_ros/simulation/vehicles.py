"""Vehicles: cars, estate cars, SUVs, vans, trucks, buses and bicycles, each a mesh about the middle of its footprint."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from radcam_depth_ros.simulation.mesh import Mesh, ball, box, join, prism, quads, tube
from radcam_depth_ros.simulation.surfaces import Label, Material, Surface, Texture


class VehicleKind(IntEnum):
    """What traffic is made of."""

    HATCHBACK = 0
    SALOON = 1
    ESTATE = 2
    SUV = 3
    VAN = 4
    TRUCK = 5
    ARTICULATED = 6
    BUS = 7


@dataclass(frozen=True)
class Vehicle:
    """One prototype; its bodywork is repainted for each vehicle.

    Attributes:
        mesh: Front towards +x, wheels on z = 0.
        length_m: Bumper to bumper.
        width_m: Without mirrors.
    """

    mesh: Mesh
    length_m: float
    width_m: float


_PAINTS = (
    (0.60, 0.60, 0.62),
    (0.75, 0.75, 0.74),
    (0.28, 0.29, 0.31),
    (0.10, 0.10, 0.11),
    (0.02, 0.02, 0.022),
    (0.012, 0.013, 0.016),
    (0.03, 0.06, 0.16),
    (0.04, 0.10, 0.30),
    (0.30, 0.02, 0.02),
    (0.50, 0.05, 0.03),
    (0.06, 0.08, 0.05),
    (0.35, 0.27, 0.17),
    (0.60, 0.40, 0.05),
)


def paint(rng: np.random.Generator) -> tuple[float, float, float]:
    """A colour of bodywork, most often white, grey or black."""
    return _PAINTS[int(rng.integers(len(_PAINTS)))]


def build_vehicle(rng: np.random.Generator, kind: VehicleKind) -> Vehicle:
    """A vehicle of a kind, with its own proportions."""
    if kind is VehicleKind.VAN:
        return _van(rng)
    if kind in (VehicleKind.TRUCK, VehicleKind.ARTICULATED):
        return _truck(rng, articulated=kind is VehicleKind.ARTICULATED)
    if kind is VehicleKind.BUS:
        return _bus(rng)
    return _car(rng, kind)


def _material(surface: Surface, label: Label, colour: tuple[float, float, float]) -> Material:
    return Material(surface, label, colour)


def _glass(label: Label) -> Material:
    return Material(Surface.GLASS, label, (0.015, 0.018, 0.02))


def _wheels(label: Label, positions_x: tuple[float, ...], track: float, radius: float, sections: int = 14) -> list[Mesh]:
    tyre = _material(Surface.RUBBER, label, (0.02, 0.02, 0.022))
    rim = Material(Surface.METAL, label, (0.35, 0.35, 0.37), Texture.GRILLE, radius)
    upright = [tube(radius, 0.22, tyre, sections), tube(radius * 0.62, 0.235, rim, 10)]
    # Laid on their side, open end towards the vehicle.
    turned = [_laid(part) for part in upright]
    wheels = []
    for x in positions_x:
        for side in (-1.0, 1.0):
            yaw = 0.0 if side > 0 else np.pi
            wheels += [part.moved((x, side * (track / 2 - 0.2), radius), yaw) for part in turned]
    return wheels


def _laid(mesh: Mesh) -> Mesh:
    order = [0, 2, 1]
    return Mesh(
        np.ascontiguousarray(mesh.corners[..., order]),
        np.ascontiguousarray(mesh.normals[..., order]),
        mesh.uv,
        mesh.colour,
        mesh.texture,
        mesh.surface,
        mesh.label,
    )


def _lamps(label: Label, front_x: float, rear_x: float, half_width: float, height: float, size: float) -> list[Mesh]:
    white = _material(Surface.LAMP, label, (0.8, 0.8, 0.75))
    red = _material(Surface.LAMP, label, (0.45, 0.015, 0.01))
    parts = []
    for side in (-1, 1):
        y = side * (half_width - 0.24)
        parts.append(box([0.12, 0.36, 0.15 * size], [front_x - 0.05, y, height], white))
        parts.append(box([0.1, 0.26 if size < 1.2 else 0.16, 0.22 * size], [rear_x + 0.04, y + side * 0.04, height + 0.1], red))
    plate = _material(Surface.SIGN_FACE, label, (0.7, 0.7, 0.66))
    parts.append(box([0.03, 0.5, 0.11], [rear_x - 0.005, 0, height - 0.12], plate))
    parts.append(box([0.03, 0.5, 0.11], [front_x + 0.005, 0, height - 0.22], plate))
    return parts


def _car(rng: np.random.Generator, kind: VehicleKind) -> Vehicle:
    label = Label.CAR
    body = _material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    trim = _material(Surface.RUBBER, label, (0.025, 0.025, 0.027))
    tall = kind is VehicleKind.SUV
    length = float({0: rng.uniform(3.6, 4.2), 1: rng.uniform(4.4, 4.9), 2: rng.uniform(4.5, 4.9)}.get(kind, rng.uniform(4.2, 4.9)))
    width = float(rng.uniform(1.68, 1.84) + (0.06 if tall else 0))
    height = float(rng.uniform(1.62, 1.8) if tall else rng.uniform(1.42, 1.53))
    low = 0.24 + (0.08 if tall else 0.0)
    belt = height * float(rng.uniform(0.60, 0.65))
    front, rear = length / 2, -length / 2
    bonnet = front - length * float(rng.uniform(0.22, 0.27))
    # Where the roof ends and where the rear window meets the body make the kind.
    roof_end, window_end = {
        VehicleKind.HATCHBACK: (rear + 0.55, rear + 0.16),
        VehicleKind.SALOON: (rear + 1.35, rear + 0.62),
        VehicleKind.ESTATE: (rear + 0.50, rear + 0.12),
    }.get(kind, (rear + 0.45, rear + 0.10))
    roof_start = bonnet - length * float(rng.uniform(0.13, 0.19))
    nose = belt * float(rng.uniform(0.80, 0.9))
    lower = [
        (rear + 0.10, low), (front - 0.15, low), (front - 0.02, low + 0.15), (front, nose - 0.22), (front - 0.12, nose - 0.05),
        (bonnet, belt), (window_end, belt + 0.02), (rear + 0.03, belt - 0.05), (rear, low + 0.28),
    ]
    upper = [(bonnet, belt - 0.02), (roof_start, height - 0.05), (roof_end, height - 0.06), (window_end, belt)]
    roof = [
        (roof_start + 0.1, height - 0.09), (roof_start - 0.08, height - 0.015), ((roof_start + roof_end) / 2, height),
        (roof_end + 0.1, height - 0.02), (roof_end - 0.08, height - 0.1),
    ]
    cabin_width = width * float(rng.uniform(0.92, 0.95))
    parts = [
        prism(lower, width, body, width * 0.97, bulge=0.16),
        prism(upper, cabin_width, _glass(label), width * 0.74, bulge=0.1),
        prism(roof, width * 0.765, body, width * 0.72, bulge=0.05),
        box([length * 0.94, width * 0.97, 0.14], [0, 0, low + 0.03], trim),
    ]
    parts += _pillars(label, width, belt, height, bonnet, roof_start, roof_end, window_end, body)
    parts += _lamps(label, front, rear, width / 2, belt - 0.2, float(rng.uniform(0.9, 1.5)))
    mirror = [box([0.16, 0.2, 0.15], [bonnet - 0.35, side * (width / 2 + 0.06), belt + 0.06], body) for side in (-1, 1)]
    wheel = 0.36 if tall else 0.315
    axle = length * 0.29
    grille = Material(Surface.RUBBER, label, (0.05, 0.05, 0.05), Texture.GRILLE, 0.5)
    parts += [box([0.05, width * 0.5, 0.22], [front - 0.01, 0, low + 0.25], grille), *mirror]
    parts += _wheels(label, (-axle, axle * 1.02), width, wheel)
    return Vehicle(join(parts), length, width)


def _pillars(
    label: Label, width: float, belt: float, height: float, bonnet: float, start: float, end: float, rear: float, body: Material
) -> list[Mesh]:
    """Strips of bodywork over the glass, just outside of it."""
    faces = []
    wide, narrow = width * 0.47 + 0.012, width * 0.37 + 0.018
    top = height - 0.07
    lines = (
        ((bonnet + 0.02, belt), (start + 0.02, top), 0.07),
        ((start + (end - start) * 0.45, belt), (start + (end - start) * 0.45, top), 0.09),
        ((rear + 0.14, belt), (end + 0.1, top), 0.26),
    )
    for (low_x, low_z), (high_x, high_z), thickness in lines:
        for side in (-1, 1):
            faces.append(
                [
                    (low_x - thickness, side * wide, low_z),
                    (low_x, side * wide, low_z),
                    (high_x, side * narrow, high_z),
                    (high_x - thickness, side * narrow, high_z),
                ]
            )
    return [quads(faces, body)]


def _van(rng: np.random.Generator) -> Vehicle:
    label = Label.CAR if rng.random() < 0.6 else Label.TRUCK
    body = _material(Surface.BODYWORK, label, (0.7, 0.7, 0.7))
    length, width, height = (float(rng.uniform(*bounds)) for bounds in ((4.8, 6.2), (1.9, 2.05), (1.95, 2.65)))
    front, rear, low = length / 2, -length / 2, 0.3
    nose = float(rng.uniform(1.05, 1.2))
    screen = front - float(rng.uniform(0.5, 0.9))
    profile = [
        (rear, low), (front - 0.1, low), (front, low + 0.3), (front - 0.04, nose - 0.1), (screen, nose + 0.1),
        (screen - 0.75, height - 0.1), (screen - 1.1, height), (rear + 0.12, height), (rear, height - 0.1),
    ]
    glass = _glass(label)
    windscreen = [
        (screen + 0.03, -width * 0.44, nose + 0.12), (screen + 0.03, width * 0.44, nose + 0.12),
        (screen - 0.70, width * 0.40, height - 0.14), (screen - 0.70, -width * 0.40, height - 0.14),
    ]
    panes = [windscreen]
    rows = [(screen - 0.25, screen - 1.25)]
    if rng.random() < 0.6:
        rows += [(screen - 1.45, screen - 2.6), (screen - 2.75, rear + 0.3)]
    for begin, stop in rows:
        for side in (-1, 1):
            base, peak = width * 0.493 + 0.01, width * 0.462 + 0.012
            panes.append([(begin, side * base, nose + 0.15), (stop, side * base, nose + 0.15),
                          (stop, side * peak, height * 0.85), (begin - 0.35 * (begin > screen - 1), side * peak, height * 0.85)])
    if rng.random() < 0.7:
        panes.append([(rear - 0.012, -width * 0.4, nose + 0.2), (rear - 0.012, width * 0.4, nose + 0.2),
                      (rear - 0.012, width * 0.38, height * 0.86), (rear - 0.012, -width * 0.38, height * 0.86)])
    parts = [prism(profile, width, body, width * 0.92, bulge=0.06), quads(panes, glass)]
    parts += _lamps(label, front, rear, width / 2, 0.85, 1.4)
    parts += [box([0.12, 0.18, 0.3], [screen - 0.1, side * (width / 2 + 0.1), nose + 0.3], glass) for side in (-1, 1)]
    parts += _wheels(label, (-length * 0.29, length * 0.31), width, 0.34)
    return Vehicle(join(parts), length, width)


def _truck(rng: np.random.Generator, articulated: bool) -> Vehicle:
    label = Label.TRUCK
    cab_paint = _material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    load = float(rng.uniform(11, 13.6) if articulated else rng.uniform(4.5, 7.5))
    width, height = 2.5, float(rng.uniform(3.3, 4.0) if articulated else rng.uniform(2.8, 3.6))
    cab = 2.2
    length = load + cab + 0.4
    front, rear = length / 2, -length / 2
    tone = [(0.75, 0.75, 0.72), (0.55, 0.56, 0.55), (0.05, 0.12, 0.32), (0.35, 0.04, 0.03), (0.08, 0.22, 0.1)]
    colour = tone[int(rng.choice(5, p=[0.45, 0.2, 0.15, 0.1, 0.1]))]
    texture = Texture.SIGN if rng.random() < 0.4 and max(colour) > 0.5 else Texture.METAL
    canvas = Material(Surface.CANVAS, label, colour, texture, 2.6)
    frame = _material(Surface.METAL, label, (0.05, 0.05, 0.055))
    cab_high = min(height - 0.1, float(rng.uniform(2.6, 3.4)))
    profile = [(front - cab, 0.5), (front - 0.08, 0.4), (front, 0.6), (front - 0.05, 1.5), (front - 0.35, cab_high - 0.1),
               (front - 0.6, cab_high), (front - cab, cab_high)]
    screen = [(front - 0.04, -1.05, 1.6), (front - 0.04, 1.05, 1.6), (front - 0.28, 1.0, cab_high - 0.45), (front - 0.28, -1.0, cab_high - 0.45)]
    doors = [[(front - 0.4, side * 1.215, 1.55), (front - 1.3, side * 1.215, 1.55), (front - 1.3, side * 1.205, 2.25), (front - 0.55, side * 1.205, 2.25)]
             for side in (-1, 1)]
    parts = [
        box([load, width, height - 1.05], [rear + load / 2, 0, (height + 1.05) / 2], canvas),
        box([length - 0.6, 0.9, 0.3], [-0.1, 0, 0.8], frame),
        box([0.12, 2.3, 0.12], [rear + 0.15, 0, 0.55], frame),
        prism(profile, 2.42, cab_paint, 2.34, bulge=0.08),
        quads([screen, *doors], _glass(label)),
    ]
    parts += _lamps(label, front, rear, 1.2, 0.85, 1.1)
    axles = (front - 1.3, rear + 1.4, rear + 2.7) if not articulated else (front - 1.3, front - 4.2, rear + 1.4, rear + 2.7, rear + 4.0)
    parts += _wheels(label, axles, width, 0.5)
    return Vehicle(join(parts), length, width)


def _bus(rng: np.random.Generator) -> Vehicle:
    label = Label.BUS
    body = _material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    length, width, height = float(rng.uniform(10.5, 12.2)), 2.5, float(rng.uniform(2.9, 3.2))
    front, rear = length / 2, -length / 2
    profile = [(rear, 0.35), (front - 0.05, 0.35), (front, 0.7), (front - 0.02, 1.2), (front - 0.18, height - 0.15),
               (front - 0.4, height), (rear + 0.1, height), (rear, height - 0.15)]
    panes = [[(x, side * 1.262, 1.15), (x + 1.5, side * 1.262, 1.15), (x + 1.5, side * 1.245, 2.5), (x, side * 1.245, 2.5)]
             for side in (-1, 1) for x in np.arange(rear + 0.3, front - 1.8, 1.6)]
    panes.append([(front + 0.0, -1.15, 0.95), (front + 0.0, 1.15, 0.95), (front - 0.11, 1.12, 2.6), (front - 0.11, -1.12, 2.6)])
    panes.append([(rear - 0.012, -1.0, 1.5), (rear - 0.012, 1.0, 1.5), (rear - 0.012, 1.0, 2.4), (rear - 0.012, -1.0, 2.4)])
    parts = [prism(profile, width, body, width * 0.985), quads(panes, _glass(label))]
    parts += [box([0.06, 1.4, 0.25], [front - 0.12, 0, height - 0.28], _material(Surface.LAMP, label, (0.6, 0.35, 0.02)))]
    parts += _lamps(label, front, rear, 1.2, 0.75, 1.3)
    parts += _wheels(label, (front - 2.7, rear + 3.2), width, 0.48)
    return Vehicle(join(parts), length, width)


def build_bicycle(rng: np.random.Generator, with_rider: bool) -> Mesh:
    """A bicycle, with somebody on it or parked."""
    label = Label.BICYCLE
    frame = _material(Surface.METAL, label, tuple(rng.uniform(0.02, 0.4, 3)))
    tyre = _material(Surface.RUBBER, label, (0.02, 0.02, 0.02))
    ring = tube(0.34, 0.04, tyre, 14)
    parts = [_laid(ring).moved((x, -0.02, 0.34)) for x in (-0.52, 0.52)]
    parts += [
        box([0.75, 0.04, 0.05], [0, 0, 0.75], frame),
        box([0.05, 0.04, 0.5], [-0.2, 0, 0.6], frame),
        box([0.05, 0.04, 0.6], [0.48, 0, 0.7], frame),
        box([0.06, 0.5, 0.04], [0.42, 0, 1.02], frame),
        box([0.22, 0.14, 0.06], [-0.22, 0, 0.95], tyre),
    ]
    if with_rider:
        coat = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.5, 3)), Texture.CLOTH, 0.5)
        legs = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.2, 3)), Texture.CLOTH, 0.5)
        skin = _material(Surface.CLOTH, Label.RIDER, (0.45, 0.28, 0.2))
        parts += [
            ball(0.3, (0.0, 0, 1.3), coat, (0.7, 0.75, 1.1)),
            ball(0.11, (0.16, 0, 1.74), skin, (1, 1, 1.2)),
            *(ball(0.1, (0.0, side * 0.12, 0.72 + 0.08 * side), legs, (1.2, 0.9, 3.8)) for side in (-1, 1)),
            *(ball(0.06, (0.22, side * 0.22, 1.25), coat, (3.6, 1, 1.6)) for side in (-1, 1)),
        ]
    return join(parts)
