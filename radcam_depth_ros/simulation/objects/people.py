"""People on foot, in poses of one step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join

POSES = 6
"""Poses of one double step."""

STRIDE_M = 1.5
"""Metres walked in one double step."""


@dataclass(frozen=True)
class Walker:
    """One prototype.

    Attributes:
        poses: `POSES` meshes of one double step, facing +x, feet on z = 0; the first one also serves for standing.
    """

    poses: tuple[Mesh, ...]


def build_walker(rng: np.random.Generator) -> Walker:
    """Somebody with a size and clothes of their own."""
    dark = rng.random() < 0.6
    upper = rng.uniform(0.01, 0.12 if dark else 0.6, 3)
    lower = rng.uniform(0.01, 0.15, 3)
    skin = np.array([0.45, 0.28, 0.2]) * rng.uniform(0.35, 1.2)
    coat, legs, bare = (
        Material(Surface.CLOTH, Label.PERSON, (float(c[0]), float(c[1]), float(c[2])), Texture.CLOTH, 0.6)
        for c in (upper, lower, skin)
    )
    hair = Material(Surface.CLOTH, Label.PERSON, (0.02, 0.016, 0.012))
    long_coat = float(rng.uniform(0.9, 1.3))
    girth = float(rng.uniform(0.85, 1.2))
    size = float(rng.uniform(0.92, 1.08)) * (0.68 if rng.random() < 0.12 else 1.0)
    trunk = [
        ball(0.25, (0, 0, 1.18), coat, (0.58 * girth, 0.86 * girth, 1.3 * long_coat), 8),
        ball(0.09, (0, 0, 1.49), bare, (0.8, 0.8, 1.2), 6),
        ball(0.105, (0.01, 0, 1.64), bare, (1, 0.88, 1.22), 6),
        ball(0.112, (-0.015, 0, 1.67), hair, (1, 0.92, 1.1), 6),
    ]
    if rng.random() < 0.3:
        bag = Material(Surface.CLOTH, Label.PERSON, tuple(rng.uniform(0.02, 0.4, 3)), Texture.CLOTH, 0.6)
        trunk.append(box([0.16, 0.3, 0.42], [-0.2, 0, 1.22], bag))
    limbs = [_limb(legs, side * 0.1, 0.0, 0.88, 0.085, 0.06) for side in (-1, 1)]
    arms = [_limb(coat, side * 0.27, 0.78, 1.42, 0.055, 0.045) for side in (-1, 1)]
    poses = []
    for pose in range(POSES):
        swing = 0.45 * np.sin(2 * np.pi * pose / POSES)
        parts = [
            *trunk,
            *(limb.swung(side * swing, 0.88) for limb, side in zip(limbs, (1, -1), strict=True)),
            *(arm.swung(side * swing * 0.8, 1.42) for arm, side in zip(arms, (-1, 1), strict=True)),
        ]
        poses.append(join(parts).moved((0, 0, 0), scale=size))
    return Walker(tuple(poses))


def _limb(material: Material, y: float, low: float, high: float, thick: float, thin: float) -> Mesh:
    shoe = Material(Surface.CLOTH, Label.PERSON, (0.03, 0.03, 0.03))
    middle, half = (low + high) / 2, (high - low) / 2
    parts = [ball(half, (0, y, middle), material, (thick / half, thick / half, 1.0), 5)]
    if low < 0.1:
        parts.append(ball(0.1, (0.05, y, 0.05), shoe, (1.4, 0.5, 0.5), 5))
        parts.append(ball(0.2, (0, y, 0.25), material, (thin / 0.2, thin / 0.2, 1.2), 5))
    return join(parts)
