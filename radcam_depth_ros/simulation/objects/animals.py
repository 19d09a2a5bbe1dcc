"""Animals: dogs, deer, horses, cows."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join
from radcam_depth_ros.simulation.settings.randomness import pick


class AnimalKind(IntEnum):
    """Kinds of animal beside or on a road."""

    DOG = 0
    DEER = 1
    HORSE = 2
    COW = 3


# Height of the back, length of the trunk, girth, length of the neck, colours.
_BUILDS = {
    AnimalKind.DOG: (0.55, 0.7, 0.13, 0.16, ((0.05, 0.04, 0.03), (0.3, 0.2, 0.1), (0.5, 0.45, 0.4))),
    AnimalKind.DEER: (0.9, 0.95, 0.18, 0.4, ((0.16, 0.09, 0.05), (0.1, 0.07, 0.05))),
    AnimalKind.HORSE: (1.5, 1.6, 0.3, 0.65, ((0.1, 0.05, 0.03), (0.03, 0.025, 0.02), (0.45, 0.42, 0.38))),
    AnimalKind.COW: (1.35, 1.7, 0.38, 0.3, ((0.2, 0.09, 0.04), (0.5, 0.48, 0.45), (0.03, 0.03, 0.03))),
}


def build_animal(rng: np.random.Generator, kind: AnimalKind) -> Mesh:
    """An animal that stands on the origin and looks along x."""
    back, length, girth, neck, colours = _BUILDS[kind]
    coat = Material(Surface.CLOTH, Label.IGNORE, pick(rng, colours), Texture.BARK, 0.5)
    middle = back - girth
    stance = rng.uniform(0.0, 0.12) * back
    rise = neck * rng.uniform(-0.3, 1.0)
    head_x = length / 2 + neck * 0.7
    legs = [
        box([0.07 * back + 0.02, 0.06 * back + 0.02, middle], [x, y, middle / 2], coat, (1.5, 1.5)).moved((shift, 0, 0))
        for x in (-length * 0.4, length * 0.4)
        for y, shift in ((-girth * 0.55, stance), (girth * 0.55, -stance))
    ]
    steps = np.linspace(0, 1, 4)
    throat = [
        ball(girth * (0.62 - 0.2 * step), (length * 0.42 + step * neck * 0.6, 0, middle + step * rise), coat)
        for step in steps
    ]
    head = ball(girth * 0.42, (head_x, 0, middle + rise * 1.05), coat, (1.7, 0.8, 0.9))
    ears = [
        box([0.03, 0.03, girth * 0.6], [head_x - girth * 0.3, y, middle + rise + girth * 0.5], coat)
        for y in (-girth * 0.25, girth * 0.25)
    ]
    trunk = ball(girth, (0, 0, middle), coat, (length / 2 / girth, 0.85, 1.0), 10)
    tail = box([0.05, 0.05, girth * 1.4], [-length / 2, 0, middle - girth * 0.4], coat)
    return join([trunk, *legs, *throat, head, *ears, tail]).moved((0, 0, 0), scale=rng.uniform(0.85, 1.15))
