from __future__ import annotations

from radcam_depth_ros.classes import CLASS_GROUPS, CLASS_NAMES, GROUP_OF_CLASS, ROAD_GROUP


def test_every_class_is_in_one_group() -> None:
    members = [name for group in CLASS_GROUPS.values() for name in group]
    assert sorted(members) == sorted(CLASS_NAMES)
    assert len(CLASS_NAMES) == 19
    assert ROAD_GROUP in CLASS_GROUPS


def test_the_group_of_a_class_is_the_one_that_names_it() -> None:
    groups = tuple(CLASS_GROUPS.values())
    assert all(name in groups[group] for name, group in zip(CLASS_NAMES, GROUP_OF_CLASS, strict=True))
