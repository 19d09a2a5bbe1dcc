"""Bicycles, with somebody on them or parked."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.mesh import Mesh, ball, box, join, tube
from radcam_depth_ros.simulation.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.vehicle_parts import coat, laid


def build_bicycle(rng: np.random.Generator, with_rider: bool) -> Mesh:
    """A bicycle, with somebody on it or parked."""
    label = Label.BICYCLE
    frame = coat(Surface.METAL, label, tuple(rng.uniform(0.02, 0.4, 3)))
    tyre = coat(Surface.RUBBER, label, (0.02, 0.02, 0.02))
    ring = tube(0.34, 0.04, tyre, 14)
    parts = [laid(ring).moved((x, -0.02, 0.34)) for x in (-0.52, 0.52)]
    parts += [
        box([0.75, 0.04, 0.05], [0, 0, 0.75], frame),
        box([0.05, 0.04, 0.5], [-0.2, 0, 0.6], frame),
        box([0.05, 0.04, 0.6], [0.48, 0, 0.7], frame),
        box([0.06, 0.5, 0.04], [0.42, 0, 1.02], frame),
        box([0.22, 0.14, 0.06], [-0.22, 0, 0.95], tyre),
    ]
    if with_rider:
        jacket = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.5, 3)), Texture.CLOTH, 0.5)
        legs = Material(Surface.CLOTH, Label.RIDER, tuple(rng.uniform(0.02, 0.2, 3)), Texture.CLOTH, 0.5)
        skin = coat(Surface.CLOTH, Label.RIDER, (0.45, 0.28, 0.2))
        parts += [
            ball(0.3, (0.0, 0, 1.3), jacket, (0.7, 0.75, 1.1)),
            ball(0.11, (0.16, 0, 1.74), skin, (1, 1, 1.2)),
            *(ball(0.1, (0.0, side * 0.12, 0.72 + 0.08 * side), legs, (1.2, 0.9, 3.8)) for side in (-1, 1)),
            *(ball(0.06, (0.22, side * 0.22, 1.25), jacket, (3.6, 1, 1.6)) for side in (-1, 1)),
        ]
    return join(parts)
