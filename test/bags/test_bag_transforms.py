from __future__ import annotations

import numpy as np

from radcam_depth_ros.bags import BagReader, BagWriter, factory, read_static_transforms
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import StampedTransform, encode_transforms


def test_all_static_transforms_of_a_bag_make_one_tree(tmp_path):
    links = [("base_link", "camera", (1.5, 0.0, 1.4)), ("base_link", "radar", (3.5, 0.0, 0.5))]
    with BagWriter(tmp_path / "drive") as bag:
        for index, (parent, child, place) in enumerate(links):
            link = StampedTransform(parent, child, 0, RigidTransform(np.eye(3), np.array(place)))
            bag.write("/tf_static", encode_transforms(factory, [link]), index)
    with BagReader(tmp_path / "drive") as bag:
        tree = read_static_transforms(bag)
    np.testing.assert_allclose(tree.lookup("camera", "radar").translation, [2.0, 0.0, -0.9])


def test_a_bag_without_transforms_gives_an_empty_tree(tmp_path):
    with BagWriter(tmp_path / "drive"):
        pass
    with BagReader(tmp_path / "drive") as bag:
        assert read_static_transforms(bag).frames == ()


def test_the_real_drive(astyx_val):
    with BagReader(astyx_val) as bag:
        tree = read_static_transforms(bag)
    assert tree.can_transform("camera_front_optical", "radar_front")
    assert tree.can_transform("camera_front_optical", "lidar_top")
