"""Transforms that disagree."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radcam_depth_ros.frame_builder.transforms import TransformIntake
from radcam_depth_ros.geometry import MAX_LINKS, RigidTransform, TransformTree
from radcam_depth_ros.messages import StampedTransform
from radcam_depth_ros.motion import Memory, Mounts


def link(x_m: float, turned_deg: float = 0.0, parent: str = "base", child: str = "radar") -> StampedTransform:
    half = math.radians(turned_deg) / 2
    pose = RigidTransform.from_quaternion((x_m, 0.0, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))
    return StampedTransform(parent, child, 0, pose)


def intake(*, refuses_jumps: bool = False) -> tuple[TransformIntake, TransformTree]:
    tree = TransformTree()
    mounts = Mounts(tree, Memory(reach_ns=10**8, jump_ns=10**8, kept=100))
    return TransformIntake(tree, mounts, refuses_jumps=refuses_jumps), tree


def x_of(tree: TransformTree) -> float:
    return float(tree.lookup("base", "radar").translation[0])


def test_a_static_frame_is_not_moved_by_tf() -> None:
    taken, tree = intake()
    taken.add([link(1.0)], is_static=True)
    moved = taken.add([link(16.0), link(2.0, child="wheel")], is_static=False)
    assert [entry.child_frame for entry in moved] == ["wheel"]
    assert x_of(tree) == 1.0
    assert "'radar' to be placed by one of /tf_static and /tf, got both, 15.00 m and 0.0 degrees apart" in taken.problem
    taken.add([link(1.05)], is_static=False)
    assert taken.problem == "", "both say the same again"


def test_a_frame_below_two_parents_is_told() -> None:
    taken, tree = intake()
    taken.add([link(1.0)], is_static=True)
    taken.add([link(1.0, parent="other")], is_static=False)
    assert "below 'base' and below 'other'" in taken.problem
    assert tree.parent_of("radar") == "base"


def test_a_static_transform_that_comes_late_wins() -> None:
    taken, tree = intake()
    taken.add([link(5.0)], is_static=False)
    taken.add([link(1.0)], is_static=True)
    taken.add([link(5.0)], is_static=False)
    assert x_of(tree) == 1.0


@pytest.mark.parametrize(("refuses", "x_m"), [(False, 1.5), (True, 1.0)])
def test_a_static_transform_that_jumps_is_told_and_may_be_refused(refuses: bool, x_m: float) -> None:
    taken, tree = intake(refuses_jumps=refuses)
    taken.add([link(1.0)], is_static=True)
    taken.add([link(1.5)], is_static=True)
    assert "on /tf_static to stay, got another one, 0.50 m and 0.0 degrees apart" in taken.problem
    assert x_of(tree) == x_m


@pytest.mark.parametrize("again", [link(1.0), link(1.09), link(1.0, 0.9)])
def test_what_a_driver_rounds_is_no_jump(again: StampedTransform) -> None:
    taken, tree = intake(refuses_jumps=True)
    taken.add([link(1.0)], is_static=True)
    taken.add([again], is_static=True)
    assert taken.problem == ""
    np.testing.assert_allclose(tree.lookup("base", "radar").rotation, again.parent_from_child.rotation)


def test_a_turn_is_a_jump() -> None:
    taken, _ = intake()
    taken.add([link(1.0)], is_static=True)
    taken.add([link(1.0, 2.0)], is_static=True)
    assert "0.00 m and 2.0 degrees apart" in taken.problem


NEEDED = ("camera", "radar")
VEHICLE = [link(1.0, child="mast"), link(0.2, parent="mast", child="camera"), link(3.0), link(0.5, child="lidar")]


def flood(taken: TransformIntake, count: int, *, is_static: bool, first: int = 0) -> None:
    for number in range(first, first + count, 100):
        names = [f"bogus{number + index}" for index in range(100)]
        taken.add([link(1.0, parent="nowhere", child=name) for name in names], is_static=is_static)


def crowded(*, are_static: bool = True) -> tuple[TransformIntake, TransformTree, Mounts]:
    tree = TransformTree()
    mounts = Mounts(tree, Memory(reach_ns=10**8, jump_ns=10**8, kept=100))
    taken = TransformIntake(tree, mounts, refuses_jumps=False, needed=lambda: NEEDED)
    taken.add(VEHICLE, is_static=are_static)
    return taken, tree, mounts


@pytest.mark.parametrize("is_static", [False, True])
@pytest.mark.parametrize("are_static", [False, True])
def test_bogus_frames_take_the_place_of_neither_needed_nor_new_ones(is_static: bool, are_static: bool) -> None:
    taken, tree, mounts = crowded(are_static=are_static)
    flood(taken, 3 * MAX_LINKS, is_static=is_static)
    assert tree.lookup("camera", "radar").translation[0] == pytest.approx(1.8)
    assert len(tree.frames) <= MAX_LINKS + 2
    taken.add([link(7.0, child="new radar")], is_static=True)
    assert tree.lookup("base", "new radar").translation[0] == 7.0
    assert tree.lookup("camera", "new radar").translation[0] == pytest.approx(5.8)
    assert not tree.can_transform("base", "bogus0")
    assert tree.can_transform("nowhere", f"bogus{3 * MAX_LINKS - 1}")
    assert len(mounts._moving) <= MAX_LINKS


def test_frames_of_tf_go_before_static_ones_and_those_that_still_come_stay() -> None:
    taken, tree, _ = crowded()
    for number in range(0, 3 * MAX_LINKS, 100):
        taken.add([link(0.1, parent="base", child="wheel")], is_static=False)
        flood(taken, 100, is_static=False, first=number)
    assert tree.can_transform("base", "wheel")
    assert tree.can_transform("base", "lidar")


def test_a_chain_of_bogus_frames_above_the_vehicle_is_not_needed() -> None:
    taken, tree, _ = crowded()
    above = "base"
    for number in range(2 * MAX_LINKS):
        taken.add([link(1.0, parent=f"bogus{number}", child=above)], is_static=False)
        above = f"bogus{number}"
    assert tree.can_transform("camera", "radar")
    taken.add([link(7.0, child="new radar")], is_static=True)
    assert tree.can_transform("camera", "new radar")


def test_ever_new_frames_are_told_until_a_message_has_none() -> None:
    taken, _, _ = crowded()
    flood(taken, MAX_LINKS + 100, is_static=False)
    assert f"expected at most {MAX_LINKS} frames on /tf_static and /tf, got 100 more" in taken.problem
    taken.add([link(3.0)], is_static=True)
    assert taken.problem == ""


def test_conflicts_and_jumps_of_forgotten_frames_are_forgotten() -> None:
    taken, _, _ = crowded()
    taken.add([link(9.0, child="lidar")], is_static=True)
    assert "'lidar'" in taken.problem
    flood(taken, 2 * MAX_LINKS, is_static=True)
    assert "'lidar'" not in taken.problem
