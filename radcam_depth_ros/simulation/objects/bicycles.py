"""Bicycles and motorcycles, with somebody on them or parked."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join, prism, tube
from radcam_depth_ros.simulation.objects.vehicle_parts import Vehicle, glass


def build_bicycle(rng: np.random.Generator, with_rider: bool) -> Mesh:
    """A bicycle, with somebody on it or parked."""
    label = Label.BICYCLE
    frame = Material(Surface.METAL, label, tuple(rng.uniform(0.02, 0.4, 3)))
    tyre = Material(Surface.RUBBER, label, (0.02, 0.02, 0.02))
    ring = tube(0.34, 0.04, tyre, 14).with_axes(0, 2, 1)
    parts = [ring.moved((x, -0.02, 0.34)) for x in (-0.52, 0.52)]
    parts += [
        box([0.75, 0.04, 0.05], [0, 0, 0.75], frame),
        box([0.05, 0.04, 0.5], [-0.2, 0, 0.6], frame),
        box([0.05, 0.04, 0.6], [0.48, 0, 0.7], frame),
        box([0.06, 0.5, 0.04], [0.42, 0, 1.02], frame),
        box([0.22, 0.14, 0.06], [-0.22, 0, 0.95], tyre),
    ]
    if with_rider:
        parts += _rider(rng, 0.0, 0.0)
    return join(parts)


def build_motorcycle(rng: np.random.Generator, with_rider: bool) -> Vehicle:
    """A motorcycle or scooter, with somebody on it or parked."""
    label = Label.MOTORCYCLE
    body = Material(Surface.BODYWORK, label, (0.3, 0.3, 0.3))
    tyre = Material(Surface.RUBBER, label, (0.02, 0.02, 0.02))
    metal = Material(Surface.METAL, label, (0.12, 0.12, 0.13))
    radius = rng.uniform(0.24, 0.33)
    base = rng.uniform(0.6, 0.76)
    ring = tube(radius, 0.13, tyre, 14).with_axes(0, 2, 1)
    fairing = [(base - 0.1, 0.55), (base + 0.1, 0.85), (base - 0.2, 1.15), (0.05, 0.95), (-base, 0.85), (-0.2, 0.5)]
    parts = [ring.moved((x, -0.065, radius)) for x in (-base, base)]
    parts += [
        prism(fairing, 0.32, body, 0.2),
        box([0.55, 0.3, 0.35], [0.02, 0, 0.42], metal),
        box([0.08, 0.7, 0.04], [base - 0.28, 0, 1.05], metal),
        box([0.03, 0.3, 0.3], [base - 0.12, 0, 1.2], glass(label)),
        box([0.06, 0.16, 0.14], [base + 0.02, 0, 0.95], Material(Surface.LAMP, label, (0.8, 0.8, 0.75))),
        box([0.05, 0.14, 0.08], [-base - 0.06, 0, 0.82], Material(Surface.LAMP, label, (0.45, 0.015, 0.01))),
        box([0.02, 0.2, 0.2], [-base - 0.1, 0, 0.62], Material(Surface.SIGN_FACE, label, (0.7, 0.7, 0.66))),
        box([0.5, 0.06, 0.06], [base - 0.22, 0, 0.6], metal),
    ]
    if rng.random() < 0.3:
        parts.append(box([0.35, 0.4, 0.32], [-base - 0.02, 0, 1.05], metal))
    if with_rider:
        parts += _rider(rng, -0.08, -0.12)
    return Vehicle(join(parts), 2 * (base + radius))


def _rider(rng: np.random.Generator, x: float, z: float) -> list[Mesh]:
    jacket = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.5, 3)), Texture.CLOTH, 0.5)
    legs = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.2, 3)), Texture.CLOTH, 0.5)
    bare = rng.random() < 0.5
    head = Material(Surface.CLOTH, Label.RIDER, (0.45, 0.28, 0.2) if bare else tuple(rng.uniform(0.02, 0.7, 3)))
    return [
        ball(0.3, (x, 0, 1.3 + z), jacket, (0.7, 0.75, 1.1)),
        ball(0.11 if bare else 0.14, (x + 0.16, 0, 1.74 + z), head, (1, 1, 1.2)),
        *(ball(0.1, (x, side * 0.12, 0.72 + 0.08 * side + z), legs, (1.2, 0.9, 3.8)) for side in (-1, 1)),
        *(ball(0.06, (x + 0.22, side * 0.22, 1.25 + z), jacket, (3.6, 1, 1.6)) for side in (-1, 1)),
    ]
