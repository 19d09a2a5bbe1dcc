from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from generated_messages import require_tf2_msgs
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    MessageError,
    OdometryReading,
    StampedTransform,
    decode_odometry,
    decode_transforms,
    encode_odometry,
    encode_transforms,
)

VECTORS = st.tuples(*[st.floats(-100, 100)] * 3)
POSES = st.builds(
    RigidTransform.from_quaternion,
    VECTORS,
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda quaternion: np.linalg.norm(quaternion) > 0.1),
)


def assert_same(actual: RigidTransform, expected: RigidTransform) -> None:
    np.testing.assert_allclose(actual.rotation, expected.rotation, atol=1e-9)
    np.testing.assert_array_equal(actual.translation, expected.translation)


@settings(max_examples=20, deadline=None)
@given(poses=st.lists(POSES, max_size=3))
def test_transforms_come_back(maker, poses):
    if not maker.has_tf2:
        require_tf2_msgs()
    links = [StampedTransform("base", f"sensor_{index}", 7 + index, pose) for index, pose in enumerate(poses)]
    message = maker.send(encode_transforms(maker.make, links), "tf2_msgs/msg/TFMessage")
    decoded = decode_transforms(message)
    assert len(decoded) == len(links)
    for actual, expected in zip(decoded, links, strict=True):
        assert (actual.parent_frame, actual.child_frame) == (expected.parent_frame, expected.child_frame)
        assert actual.stamp_ns == expected.stamp_ns
        assert_same(actual.parent_from_child, expected.parent_from_child)


@settings(max_examples=20, deadline=None)
@given(pose=POSES, linear=VECTORS, angular=VECTORS)
def test_odometry_comes_back(maker, pose, linear, angular):
    odometry = OdometryReading(5_000_000_001, "odom", "base_footprint", pose, np.array(linear), np.array(angular))
    actual = decode_odometry(maker.send(encode_odometry(maker.make, odometry), "nav_msgs/msg/Odometry"))
    assert (actual.stamp_ns, actual.frame_id, actual.child_frame_id) == (5_000_000_001, "odom", "base_footprint")
    assert_same(actual.pose, pose)
    np.testing.assert_array_equal(actual.linear, linear)
    np.testing.assert_array_equal(actual.angular, angular)


def test_a_rotation_of_zeros_is_refused_naming_its_frames(make):
    message = encode_transforms(make, [StampedTransform("base", "radar", 0, RigidTransform.identity())])
    message.transforms[0].transform.rotation = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)
    with pytest.raises(MessageError, match=r"the transform from 'radar' to 'base' can't be used: .*quaternion"):
        decode_transforms(message)


def test_other_messages_are_refused():
    with pytest.raises(MessageError, match="expected a tf2_msgs/TFMessage"):
        decode_transforms(SimpleNamespace(data=b""))
    with pytest.raises(MessageError, match="expected a nav_msgs/Odometry"):
        decode_odometry(SimpleNamespace(data=b""))
