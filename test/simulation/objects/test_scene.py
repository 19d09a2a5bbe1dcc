from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, join, quads
from radcam_depth_ros.simulation.objects.scene import Scene

STEEL = Material(Surface.BODYWORK, Label.CAR, (0.5, 0.5, 0.5))
ROAD = Material(Surface.ASPHALT, Label.ROAD, (0.2, 0.2, 0.2))
AHEAD = np.array([[1.0, 0.0, 0.0]], np.float32)
EYE = np.array([[0.0, 0.0, 0.5]], np.float32)


def floor() -> Mesh:
    return quads([[(-200, -200, 0), (200, -200, 0), (200, 200, 0), (-200, 200, 0)]], ROAD)


def wall(distance: float) -> Mesh:
    return box([0.2, 20.0, 4.0], [distance + 0.1, 0, 2.0], STEEL)


def test_the_nearer_of_both_parts_is_hit() -> None:
    scene = Scene(join([floor(), wall(50.0)]))
    assert scene.cast(EYE, AHEAD).distance_m == pytest.approx([50.0], abs=1e-3)
    scene.set_movers([(wall(20.0), np.array([1.0, 2.0, 3.0]))])
    hits = scene.cast(EYE, AHEAD)
    assert hits.distance_m == pytest.approx([20.0], abs=1e-3)
    assert scene.velocity[hits.face[0]].tolist() == [1.0, 2.0, 3.0]
    assert scene.faces.label[hits.face[0]] == Label.CAR
    scene.set_movers([(wall(70.0), np.zeros(3))])
    assert scene.cast(EYE, AHEAD).distance_m == pytest.approx([50.0], abs=1e-3)
    scene.set_movers([])
    assert scene.cast(EYE, AHEAD).distance_m == pytest.approx([50.0], abs=1e-3)
    assert scene.cast(EYE, -AHEAD).face.tolist() == [-1]


def test_shadows_reach_as_far_as_they_are_asked() -> None:
    scene = Scene(wall(50.0))
    scene.set_movers([(wall(30.0), np.zeros(3))])
    assert scene.occluded(EYE, AHEAD, 31.0).tolist() == [True]
    assert scene.occluded(EYE, AHEAD, 29.0).tolist() == [False]
