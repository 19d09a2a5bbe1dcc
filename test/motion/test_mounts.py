"""Sensors on mounts that move: a link is taken at the time that is asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.geometry import GeometryError, RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform
from radcam_depth_ros.motion import Memory, Mounts

SECOND = 1_000_000_000
LIVE = Memory(SECOND // 10, SECOND // 10, 100)
PAN_FROM_CAMERA = RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.2, 0.0, 0.1]))
BASE_FROM_RADAR = RigidTransform(np.eye(3), np.array([2.0, 0.3, -0.5]))


def ns(time_s: float) -> int:
    return round(time_s * SECOND)


def panned(time_s: float) -> RigidTransform:
    """A mount that turns by 0.5 rad/s."""
    yaw = 0.5 * time_s
    return RigidTransform.from_quaternion((1.0, 0, 1.5), (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)))


def place(mounts: Mounts, tree: TransformTree, parent: str, child: str, time_s: float, pose: RigidTransform) -> None:
    tree.set(parent, child, pose)
    mounts.add(StampedTransform(parent, child, ns(time_s), pose))


def vehicle() -> TransformTree:
    tree = TransformTree()
    tree.set("pan", "camera", PAN_FROM_CAMERA)
    tree.set("base", "radar", BASE_FROM_RADAR)
    tree.set("base", "pan", panned(0.0))
    return tree


def moving(tree: TransformTree) -> Mounts:
    """A camera that pans, told at 20 Hz from 1 to 2 s, on a vehicle that drives."""
    mounts = Mounts(tree, LIVE)
    for tick in range(21):
        time_s = 1 + tick / 20
        place(mounts, tree, "/odom", "base", time_s, RigidTransform(np.eye(3), np.array([20 * time_s, 0, 0])))
        place(mounts, tree, "base", "pan", time_s, panned(time_s))
    return mounts


def assert_equal(found: RigidTransform, expected: RigidTransform) -> None:
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-4)
    np.testing.assert_allclose(found.translation, expected.translation, atol=1e-4)


def expected_at(camera_s: float) -> RigidTransform:
    return (panned(camera_s) @ PAN_FROM_CAMERA).inverse() @ BASE_FROM_RADAR


@settings(max_examples=20, deadline=None)
@given(camera_s=st.floats(1.0, 2.05), radar_s=st.floats(0.5, 2.5))
def test_each_frame_is_where_it_was_at_its_time_and_the_drive_does_not_count(camera_s: float, radar_s: float) -> None:
    mounts = moving(vehicle())
    assert_equal(mounts.lookup("camera", ns(camera_s), "/radar", ns(radar_s)), expected_at(camera_s))
    back = mounts.lookup("radar", ns(radar_s), "camera", ns(camera_s))
    assert_equal(back, expected_at(camera_s).inverse())


@pytest.mark.parametrize(("asked_s", "believed_s"), [(0.2, 1.0), (2.1, 2.1), (2.4, 2.0), (9.0, 2.0)])
def test_before_and_long_after_what_was_told_the_nearest_pose_counts(asked_s: float, believed_s: float) -> None:
    mounts = moving(vehicle())
    assert_equal(mounts.lookup("camera", ns(asked_s), "radar", ns(asked_s)), expected_at(believed_s))


def test_a_tree_that_never_moves_is_taken_as_it_is() -> None:
    tree = vehicle()
    still = Mounts(tree, LIVE)
    assert still.lookup("camera", 0, "radar", 0) is tree.lookup("camera", "radar")
    place(still, tree, "odom", "base", 1.0, RigidTransform.identity())
    assert still.lookup("camera", 0, "radar", 0) is tree.lookup("camera", "radar")
    assert_equal(still.lookup("camera", 0, "camera", 0), RigidTransform.identity())


def test_after_time_jumped_backwards_what_was_before_is_forgotten() -> None:
    tree = vehicle()
    mounts = moving(tree)
    place(mounts, tree, "base", "pan", 0.1, panned(0.1))
    assert_equal(mounts.lookup("camera", ns(1.5), "radar", 0), expected_at(0.1))


def test_old_poses_are_forgotten_but_the_last_before_what_is_needed() -> None:
    mounts = moving(vehicle())
    mounts.forget_before(ns(1.52))
    assert_equal(mounts.lookup("camera", ns(1.51), "radar", 0), expected_at(1.51))
    assert_equal(mounts.lookup("camera", ns(1.2), "radar", 0), expected_at(1.5))


def test_a_frame_that_nobody_told_of_is_named() -> None:
    mounts = moving(vehicle())
    with pytest.raises(GeometryError, match="'lidar' is not known"):
        mounts.lookup("camera", 0, "lidar", 0)
