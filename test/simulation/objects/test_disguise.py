from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation import Label
from radcam_depth_ros.simulation.materials.surfaces import Material, Surface
from radcam_depth_ros.simulation.objects.disguise import Disguise
from radcam_depth_ros.simulation.objects.mesh import box

STEEL = Material(Surface.METAL, Label.POLE)


def test_a_disguise_keeps_shapes_and_changes_colours() -> None:
    mesh = box([1.0, 1.0, 1.0], [0, 0, 0], STEEL)
    disguise = Disguise(np.random.default_rng(3))
    other = disguise.worn_by(mesh)
    assert other.corners is mesh.corners
    assert np.array_equal(other.colour, disguise.worn_by(mesh).colour)
    assert not np.allclose(other.colour, mesh.colour)
    assert 0 <= other.colour.min() <= other.colour.max() <= 1
