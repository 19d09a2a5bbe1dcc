from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface
from radcam_depth_ros.simulation.objects.mesh import Mesh, ball, box, join, prism, tube

PLAIN = Material(Surface.METAL, Label.POLE)


def is_sound(mesh: Mesh) -> bool:
    lengths = np.linalg.norm(mesh.normals, axis=-1)
    return bool(np.isfinite(mesh.corners).all() and np.isfinite(mesh.uv).all() and np.allclose(lengths, 1, atol=1e-3))


@pytest.mark.parametrize(
    "mesh",
    [
        box([2.0, 3.0, 4.0], [0, 0, 2.0], PLAIN),
        tube(0.2, 4.0, PLAIN),
        ball(1.0, (0, 0, 1), PLAIN),
        prism([(-1, 0), (1, 0), (0.5, 1), (-0.5, 1)], 2.0, PLAIN, 1.0, bulge=0.1),
        join([]),
    ],
)
def test_shapes_are_sound(mesh: Mesh) -> None:
    assert is_sound(mesh)
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    assert (np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 0).all()


@settings(max_examples=25, deadline=None)
@given(x=st.floats(-500, 500), y=st.floats(-500, 500), yaw=st.floats(-4, 4))
def test_moving_keeps_shape(x: float, y: float, yaw: float) -> None:
    before = box([2.0, 3.0, 4.0], [0, 0, 2.0], PLAIN)
    after = before.moved((x, y, 0.0), yaw)
    sides = [np.linalg.norm(np.diff(mesh.corners, axis=1), axis=-1) for mesh in (before, after)]
    assert np.allclose(*sides, atol=1e-3)
    assert np.allclose(after.corners.mean(axis=(0, 1)), (x, y, 2.0), atol=1e-3)
    assert is_sound(after)
