from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.bags import factory
from radcam_depth_ros.geometry import RigidTransform, TransformTree
from radcam_depth_ros.messages import OdometryReading, StampedTransform, encode_odometry
from radcam_depth_ros.motion import Memory, Motion, MotionError, interpolate

SECOND = 1_000_000_000


def turned(yaw_rad: float, x_m: float = 0.0) -> RigidTransform:
    return RigidTransform.from_quaternion((x_m, 0, 0), (0, 0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)))


def odometry(time_s: float, x_m: float, frame: str = "base") -> object:
    pose, still = turned(0.0, x_m), np.zeros(3)
    return encode_odometry(factory, OdometryReading(round(time_s * SECOND), "odom", frame, pose, still, still))


@pytest.fixture
def motion() -> Motion:
    return Motion("/odom", is_odometry=True, transforms=TransformTree(), anchor="camera")


def live(reach_s: float = 0.1, kept: int = 1000) -> Motion:
    memory = Memory(round(reach_s * SECOND), SECOND // 10, kept)
    return Motion("/odom", is_odometry=True, transforms=TransformTree(), anchor="camera", memory=memory)


@settings(deadline=None, max_examples=30)
@given(st.floats(-3, 3), st.floats(-0.1, 0.1), st.floats(0, 1))
def test_between_two_poses_the_turn_is_even(yaw: float, step: float, share: float) -> None:
    pose = interpolate(turned(yaw), turned(yaw + step, 1.0), share)
    np.testing.assert_allclose(pose.rotation, turned(yaw + share * step).rotation, atol=1e-5)
    assert pose.translation[0] == pytest.approx(share)


def test_poses_are_interpolated_in_any_order_of_arrival(motion: Motion) -> None:
    for time_s in (1.0, 1.2, 1.1, 1.3, 1.1):
        motion.add(odometry(time_s, 10 * time_s))
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
        motion.add(odometry(time_s, 0.0))
    assert motion.at(round(1.5 * SECOND)) is None


def test_forgetting_leaves_what_later_times_need(motion: Motion) -> None:
    for index in range(100):
        motion.add(odometry(index / 10, index))
    motion.forget_before(round(5.05 * SECOND))
    assert motion.at(round(5.05 * SECOND)) is not None
    assert motion.at(round(4.9 * SECOND)) is None


def test_poses_of_another_frame_are_left_out(motion: Motion) -> None:
    motion.add(odometry(1.0, 1.0))
    motion.add(odometry(1.0, 2.0, "trailer"))
    assert motion.base_frame == "base"
    with pytest.raises(MotionError, match="empty child_frame_id"):
        motion.add(odometry(1.0, 2.0, ""))


def test_a_first_message_of_a_wrong_frame_does_not_count_for_ever(motion: Motion) -> None:
    with pytest.raises(MotionError, match="empty child_frame_id"):
        motion.add(odometry(0.9, 0.0, ""))
    motion.add(odometry(1.0, 0.0, "odom"))
    assert motion.frame_problem == ""
    for index in range(5):
        assert motion.base_frame == "odom"
        motion.add(odometry(1.1 + index / 10, 7.0))
        assert "got child_frame_id 'base' after 'odom'" in motion.frame_problem
    motion.add(odometry(1.6, 8.0))
    assert (motion.base_frame, motion.frame_problem) == ("base", "")
    pose = motion.at(round(1.55 * SECOND))
    assert pose is not None
    assert pose.translation[0] == pytest.approx(7.5)
    assert motion.at(round(1.05 * SECOND)) is None


def test_of_two_publishers_the_first_one_counts(motion: Motion) -> None:
    for index in range(20):
        motion.add(odometry(1 + index / 10, 1.0))
        for frame in ("trailer", "trailer", "roof"):
            motion.add(odometry(1 + index / 10, 2.0, frame))
            assert "second publisher" in motion.frame_problem
    assert motion.base_frame == "base"


@pytest.mark.parametrize("ahead_s", [0.02, 0.07, 0.1])
def test_soon_after_the_last_pose_the_vehicle_goes_on_as_before(ahead_s: float) -> None:
    motion = live()
    for index in range(20):  # 10 m/s, turning
        time_s = 1.0 + index / 20
        pose = turned(0.5 * time_s, 0.0)
        arc = RigidTransform(pose.rotation, np.array([20 * math.sin(0.5 * time_s), -20 * math.cos(0.5 * time_s), 0]))
        reading = OdometryReading(round(time_s * SECOND), "odom", "base", arc, np.zeros(3), np.zeros(3))
        motion.add(encode_odometry(factory, reading))
    time_s = 1.95 + ahead_s
    pose = motion.at(round(time_s * SECOND))
    assert pose is not None
    np.testing.assert_allclose(pose.rotation, turned(0.5 * time_s).rotation, atol=1e-4)
    np.testing.assert_allclose(
        pose.translation, [20 * math.sin(0.5 * time_s), -20 * math.cos(0.5 * time_s), 0], atol=5e-3
    )
    assert motion.at(round(2.06 * SECOND)) is None
    assert "0.11 s away" in motion.why_unknown(round(2.06 * SECOND))


def test_a_backward_jump_begins_anew_and_what_is_late_does_not() -> None:
    motion = live()
    for time_s in (5.0, 5.1, 5.05, 5.2):
        motion.add(odometry(time_s, 1.0))
    assert motion.at(round(5.02 * SECOND)) is not None
    motion.add(odometry(5.05, 0.0))
    assert motion.at(round(5.02 * SECOND)) is None
    motion.add(odometry(5.15, 0.0))
    pose = motion.at(round(5.1 * SECOND))
    assert pose is not None
    assert pose.translation[0] == 0.0


def test_no_more_poses_are_kept_than_wanted() -> None:
    motion = live(kept=10)
    for index in range(100):
        motion.add(odometry(1 + index / 100, index))
    assert motion.at(round(1.89 * SECOND)) is None
    assert motion.at(round(1.9 * SECOND)) is not None


def test_all_moving_links_below_the_frame_that_stands_still_count() -> None:
    tree = TransformTree()
    motion = Motion("/tf", is_odometry=False, transforms=tree, anchor="camera", odom_frame="map")
    tree.set("base", "camera", turned(0.0, 1.0))
    for index in range(11):
        time_ns = SECOND + index * SECOND // 10
        links = [
            StampedTransform("map", "odom", time_ns, turned(0.0, 100.0)),
            StampedTransform("odom", "base", time_ns, turned(0.0, float(index))),
            StampedTransform("base", "wheel", time_ns, turned(0.1 * index)),
        ]
        for link in links:
            tree.set(link.parent_frame, link.child_frame, link.parent_from_child)
        motion.add_links(links)
    pose = motion.at(SECOND + SECOND // 4)
    assert pose is not None
    assert pose.translation[0] == pytest.approx(100 + 2.5 + 1)
    assert motion.at(SECOND // 2) is None
    nowhere = Motion("/tf", is_odometry=False, transforms=tree, anchor="camera", odom_frame="earth")
    nowhere.add_links(links)
    assert nowhere.at(SECOND) is None
    assert "no pose of 'camera' in 'earth'" in nowhere.why_unknown(SECOND + 1)


def test_a_link_between_two_frames_of_the_vehicle_is_no_motion() -> None:
    transforms, still = TransformTree(), RigidTransform.identity()
    transforms.set("base", "mount", still)
    transforms.set("mount", "camera", still)
    motion = Motion("/tf", is_odometry=False, transforms=transforms, anchor="camera")
    motion.add_links([StampedTransform("base", "mount", 0, still), StampedTransform("base", "wheel", 0, still)])
    assert motion.base_frame is None
    motion.add_links([StampedTransform("odom", "base", 0, still)])
    assert motion.base_frame == "base"
