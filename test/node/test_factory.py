from __future__ import annotations

import array

import numpy as np
import pytest

from radcam_depth_ros.node.topics.factory import build_message, message_class


def test_numbers_become_what_the_field_wants() -> None:
    point = build_message("geometry_msgs/msg/Point", x=1, y=np.float32(1.5), z=True)
    assert [(type(value), value) for value in (point.x, point.y, point.z)] == [(float, 1.0), (float, 1.5), (float, 1.0)]
    field = build_message("sensor_msgs/msg/PointField", name="x", offset=np.int64(4), datatype=7, count=1.0)
    assert (type(field.offset), field.offset, type(field.count)) == (int, 4, int)


@pytest.mark.parametrize("size", [0, 1, 1000])
def test_bytes_become_an_array_without_a_loop(size: int) -> None:
    data = np.arange(size, dtype=np.uint8)
    message = build_message("sensor_msgs/msg/Image", data=data)
    assert isinstance(message.data, array.array)
    assert message.data.tobytes() == data.tobytes()


def test_memory_that_is_an_array_already_is_taken_whole() -> None:
    owner = array.array("B", bytes(48))
    depth = np.frombuffer(owner, np.float32).reshape(3, 4)
    assert build_message("sensor_msgs/msg/Image", data=depth.reshape(-1).view(np.uint8)).data is owner
    part = build_message("sensor_msgs/msg/Image", data=depth[:2].reshape(-1).view(np.uint8)).data
    assert part is not owner
    assert len(part) == 32


def test_float_sequences_and_fixed_arrays() -> None:
    info = build_message("sensor_msgs/msg/CameraInfo", d=np.array([0.1, 0.2]), k=np.arange(9.0))
    assert info.d == array.array("d", [0.1, 0.2])
    assert np.array_equal(info.k, np.arange(9.0))


def test_a_package_that_is_not_installed_is_named() -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_msgs"):
        message_class("no_such_msgs/msg/Thing")
