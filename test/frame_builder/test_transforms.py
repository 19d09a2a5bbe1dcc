"""Transforms that disagree."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radcam_depth_ros.frame_builder.transforms import TransformIntake
from radcam_depth_ros.geometry import RigidTransform, TransformTree
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
