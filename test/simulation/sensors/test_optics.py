from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.sensors.optics import motion_field, smeared

CAMERA = CameraModel(80, 48, 63.0, 63.0, 39.5, 23.5)
# Looks along the world's x axis, 1.5 m above the ground.
AHEAD = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.0, 0.0, 1.5]))


@settings(max_examples=25, deadline=None)
@given(depth=st.floats(3, 80), speed=st.floats(-20, 20), turn=st.floats(-0.3, 0.3))
def test_motion_is_the_change_of_the_projection(depth: float, speed: float, turn: float) -> None:
    velocity, rate = np.array([speed, 0.5, 0.0]), np.array([0.0, 0.0, turn])
    flow = motion_field(
        CAMERA, AHEAD, np.full((48, 80), depth, np.float32), np.zeros((48, 80, 3), np.float32), velocity, rate
    )
    row, column, step = 40, 60, 1e-4
    ray = np.array([(column - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy, 1.0])
    seen = AHEAD.rotation @ (ray * depth)
    cosine, sine = np.cos(turn * step), np.sin(turn * step)
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ AHEAD.rotation
    later = turned.T @ (seen - velocity * step)
    moved = np.array(
        [later[0] / later[2] * CAMERA.fx + CAMERA.cx - column, later[1] / later[2] * CAMERA.fy + CAMERA.cy - row]
    )
    assert flow[row, column] == pytest.approx(moved / step, abs=0.2 + 0.02 * np.abs(moved / step).max())


def test_the_sky_and_what_drives_along_stay_sharp() -> None:
    depth = np.full((48, 80), np.inf, np.float32)
    depth[24:] = 10.0
    velocity = np.zeros((48, 80, 3), np.float32)
    velocity[24:, :40, 0] = 15.0
    flow = motion_field(CAMERA, AHEAD, depth, velocity, np.array([15.0, 0, 0]), np.zeros(3))
    assert not flow[:24].any()
    assert not flow[24:, :40].any()
    assert np.abs(flow[24:, 60:]).max() > 10
    picture = np.random.default_rng(0).random((48, 80, 3)).astype(np.float32)
    blurred = smeared(picture, flow * np.float32(0.1))
    assert np.allclose(blurred[:24], picture[:24])
    assert blurred[30:, 60:].std() < picture[30:, 60:].std()
