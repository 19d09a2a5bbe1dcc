from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.bags import factory
from radcam_depth_ros.bags.topics import SensorTopics
from radcam_depth_ros.drive import DriveError
from radcam_depth_ros.drive.motion import Motion, interpolate
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import OdometryReading, encode_odometry

SECOND = 1_000_000_000
TOPICS = SensorTopics("/image", "/camera_info", ("/radar",), odometry="/odom")


def turned(yaw_rad: float, x_m: float = 0.0) -> RigidTransform:
    return RigidTransform.from_quaternion((x_m, 0, 0), (0, 0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)))


def odometry(time_s: float, x_m: float, frame: str = "base") -> object:
    pose, still = turned(0.0, x_m), np.zeros(3)
    return encode_odometry(factory, OdometryReading(round(time_s * SECOND), "odom", frame, pose, still, still))


@pytest.fixture
def motion() -> Motion:
    return Motion(TOPICS, TransformTree(), "camera")


@settings(deadline=None, max_examples=30)
@given(st.floats(-3, 3), st.floats(-0.1, 0.1), st.floats(0, 1))
def test_between_two_poses_the_turn_is_even(yaw: float, step: float, share: float) -> None:
    pose = interpolate(turned(yaw), turned(yaw + step, 1.0), share)
    np.testing.assert_allclose(pose.rotation, turned(yaw + share * step).rotation, atol=1e-5)
    assert pose.translation[0] == pytest.approx(share)


def test_poses_are_interpolated_in_any_order_of_arrival(motion: Motion) -> None:
    for time_s in (1.0, 1.2, 1.1, 1.3, 1.1):
        motion.accept(odometry(time_s, 10 * time_s))
    for time_s in (1.0, 1.05, 1.21, 1.3):
        pose = motion.at(round(time_s * SECOND))
        assert pose is not None
        assert pose.translation[0] == pytest.approx(10 * time_s)
    assert motion.at(round(0.99 * SECOND)) is None
    assert motion.at(round(1.31 * SECOND)) is None
    assert motion.covers(round(1.3 * SECOND))
    assert not motion.covers(round(1.31 * SECOND))


def test_across_a_gap_nobody_knows(motion: Motion) -> None:
    for time_s in (1.0, 2.0):
        motion.accept(odometry(time_s, 0.0))
    assert motion.at(round(1.5 * SECOND)) is None


def test_forgetting_leaves_what_later_times_need(motion: Motion) -> None:
    for index in range(100):
        motion.accept(odometry(index / 10, index))
    motion.forget_before(round(5.05 * SECOND))
    assert motion.at(round(5.05 * SECOND)) is not None
    assert motion.at(round(4.9 * SECOND)) is None


def test_poses_of_another_frame_are_left_out(motion: Motion) -> None:
    motion.accept(odometry(1.0, 1.0))
    motion.accept(odometry(1.0, 2.0, "trailer"))
    assert motion.base_frame == "base"
    with pytest.raises(DriveError, match="empty child_frame_id"):
        motion.accept(odometry(1.0, 2.0, ""))
