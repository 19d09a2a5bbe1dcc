"""Cars: hatchbacks, saloons, estate cars and SUVs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, prism, quads
from radcam_depth_ros.simulation.objects.vehicle_parts import Vehicle, VehicleKind, glass, lamps, wheels


@dataclass(frozen=True)
class _Shape:
    """Proportions in metres; x forward from the middle of the car."""

    length: float
    width: float
    height: float
    sill: float
    belt: float
    nose: float
    bonnet_x: float
    roof_start_x: float
    roof_end_x: float
    window_end_x: float
    wheel_radius: float

    @property
    def front_x(self) -> float:
        return self.length / 2

    @property
    def rear_x(self) -> float:
        return -self.length / 2


def build_car(rng: np.random.Generator, kind: VehicleKind) -> Vehicle:
    """A car with proportions of its own; its kind decides where roof and rear window end."""
    shape = _draw_shape(rng, kind)
    label = Label.CAR
    body = Material(Surface.BODYWORK, label, (0.5, 0.5, 0.5))
    trim = Material(Surface.RUBBER, label, (0.025, 0.025, 0.027))
    grille = Material(Surface.RUBBER, label, (0.05, 0.05, 0.05), Texture.GRILLE, 0.5)
    width, front = shape.width, shape.front_x
    parts = [
        *_shell(shape, rng.uniform(0.92, 0.95), body),
        box([shape.length * 0.94, width * 0.97, 0.14], [0, 0, shape.sill + 0.03], trim),
        box([0.05, width * 0.5, 0.22], [front - 0.01, 0, shape.sill + 0.25], grille),
        *(
            box([0.16, 0.2, 0.15], [shape.bonnet_x - 0.35, side * (width / 2 + 0.06), shape.belt + 0.06], body)
            for side in (-1, 1)
        ),
        _pillars(shape, body),
        *lamps(label, front, shape.rear_x, width / 2, shape.belt - 0.2, rng.uniform(0.9, 1.5)),
        *wheels(label, (-shape.length * 0.29, shape.length * 0.296), width, shape.wheel_radius),
    ]
    return Vehicle(join(parts), shape.length)


def _draw_shape(rng: np.random.Generator, kind: VehicleKind) -> _Shape:
    tall = kind is VehicleKind.SUV
    lengths = {VehicleKind.HATCHBACK: (3.6, 4.2), VehicleKind.SUV: (4.2, 4.9)}
    length = float(rng.uniform(*lengths.get(kind, (4.4, 4.9))))
    height = float(rng.uniform(1.62, 1.8) if tall else rng.uniform(1.42, 1.53))
    belt = height * rng.uniform(0.60, 0.65)
    bonnet_x = length / 2 - length * rng.uniform(0.22, 0.27)
    roof_end, window_end = {
        VehicleKind.HATCHBACK: (0.55, 0.16),
        VehicleKind.SALOON: (1.35, 0.62),
        VehicleKind.ESTATE: (0.50, 0.12),
        VehicleKind.SUV: (0.45, 0.10),
    }[kind]
    return _Shape(
        length=length,
        width=rng.uniform(1.68, 1.84) + (0.06 if tall else 0.0),
        height=height,
        sill=0.32 if tall else 0.24,
        belt=belt,
        nose=belt * rng.uniform(0.80, 0.9),
        bonnet_x=bonnet_x,
        roof_start_x=bonnet_x - length * rng.uniform(0.13, 0.19),
        roof_end_x=-length / 2 + roof_end,
        window_end_x=-length / 2 + window_end,
        wheel_radius=0.36 if tall else 0.315,
    )


def _shell(shape: _Shape, cabin_share: float, body: Material) -> list[Mesh]:
    """Body, cabin of glass and roof."""
    front, rear, belt, height = shape.front_x, shape.rear_x, shape.belt, shape.height
    start, end = shape.roof_start_x, shape.roof_end_x
    lower = [
        (rear + 0.10, shape.sill),
        (front - 0.15, shape.sill),
        (front - 0.02, shape.sill + 0.15),
        (front, shape.nose - 0.22),
        (front - 0.12, shape.nose - 0.05),
        (shape.bonnet_x, belt),
        (shape.window_end_x, belt + 0.02),
        (rear + 0.03, belt - 0.05),
        (rear, shape.sill + 0.28),
    ]
    upper = [(shape.bonnet_x, belt - 0.02), (start, height - 0.05), (end, height - 0.06), (shape.window_end_x, belt)]
    roof = [
        (start + 0.1, height - 0.09),
        (start - 0.08, height - 0.015),
        ((start + end) / 2, height),
        (end + 0.1, height - 0.02),
        (end - 0.08, height - 0.1),
    ]
    width = shape.width
    return [
        prism(lower, width, body, width * 0.97, bulge=0.16, flank=Texture.LIVERY_0),
        prism(upper, width * cabin_share, glass(body.label), width * 0.74, bulge=0.1),
        prism(roof, width * 0.765, body, width * 0.72, bulge=0.05),
    ]


def _pillars(shape: _Shape, body: Material) -> Mesh:
    """Strips of bodywork over the glass, just outside of it."""
    wide, narrow = shape.width * 0.47 + 0.012, shape.width * 0.37 + 0.018
    belt, top = shape.belt, shape.height - 0.07
    start, end = shape.roof_start_x, shape.roof_end_x
    middle = start + (end - start) * 0.45
    front, rear = (shape.bonnet_x + 0.02, start + 0.02, 0.07), (shape.window_end_x + 0.14, end + 0.1, 0.26)
    faces = []
    for low, high, thickness in (front, (middle, middle, 0.09), rear):
        for y, upper_y in ((-wide, -narrow), (wide, narrow)):
            foot, head = [(low - thickness, y, belt), (low, y, belt)], [(high, upper_y, top)]
            faces.append([*foot, *head, (high - thickness, upper_y, top)])
    return quads(faces, body)
