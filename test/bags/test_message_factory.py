from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.bags import BagError, factory
from radcam_depth_ros.bags.definitions import MessageType, jazzy_typestore


@pytest.mark.parametrize("type_name", sorted(jazzy_typestore().fielddefs))
def test_defaults_of_every_type_serialise_and_come_back(type_name):
    kind = MessageType.jazzy(type_name)
    message = factory(type_name)
    raw = bytes(kind.serialise(message, "/topic"))
    back = kind.deserialise(raw, "/topic")
    assert bytes(kind.serialise(back, "/topic")) == raw


def test_defaults_are_those_of_ros():
    info = factory("sensor_msgs/msg/CameraInfo")
    assert (info.header.frame_id, info.header.stamp.sec, info.roi.do_rectify) == ("", 0, False)
    assert info.k.dtype == np.float64
    assert info.k.tolist() == [0.0] * 9
    assert info.d.shape == (0,)
    assert factory("geometry_msgs/msg/Transform").rotation.w == 1.0
    assert factory("sensor_msgs/msg/PointCloud2").fields == []
    assert factory("sensor_msgs/msg/Image").data.dtype == np.uint8


def test_fields_are_set_and_converted():
    stamp = factory("builtin_interfaces/msg/Time", sec=np.int64(3), nanosec=np.uint32(7))
    header = factory("std_msgs/msg/Header", stamp=stamp, frame_id="camera")
    info = factory("sensor_msgs/msg/CameraInfo", header=header, d=[1, 2, 3], k=np.eye(3, dtype=np.float32).ravel())
    assert type(info.header.stamp.sec) is int
    assert info.header.frame_id == "camera"
    assert info.d.dtype == info.k.dtype == np.float64
    assert info.d.tolist() == [1.0, 2.0, 3.0]
    assert factory("sensor_msgs/msg/Image", data=[0, 255]).data.dtype == np.uint8
    assert factory("sensor_msgs/msg/Image", data=b"\x01\x02").data.tolist() == [1, 2]


def test_image_data_is_not_copied():
    data = np.arange(12, dtype=np.uint8)
    assert np.shares_memory(factory("sensor_msgs/msg/Image", data=data).data, data)


@pytest.mark.parametrize(
    ("type_name", "fields", "sentence"),
    [
        ("sensor_msgs/msg/Picture", {}, "not one of ROS 2 Jazzy"),
        ("sensor_msgs/msg/Image", {"widht": 3}, "no field 'widht'.*width"),
        ("sensor_msgs/msg/Image", {"width": 3.5}, "width takes uint32, got 3.5"),
        ("sensor_msgs/msg/Image", {"width": -1}, "width takes uint32, got -1"),
        ("sensor_msgs/msg/Image", {"encoding": 8}, "encoding takes string"),
        ("sensor_msgs/msg/Image", {"header": "camera"}, "header takes a std_msgs/msg/Header, got str"),
        ("sensor_msgs/msg/Image", {"data": np.zeros((2, 2), np.uint8)}, "takes a sequence of uint8"),
        ("sensor_msgs/msg/Image", {"data": np.zeros(2, np.float32)}, "takes a sequence of uint8"),
        ("sensor_msgs/msg/Image", {"data": [1, 256]}, "takes a sequence of uint8"),
        ("sensor_msgs/msg/CameraInfo", {"k": [1.0]}, "takes 9 values, got 1"),
        ("sensor_msgs/msg/PointCloud2", {"fields": "xyz"}, "fields takes a list"),
        ("sensor_msgs/msg/PointCloud2", {"fields": ["x"]}, "fields takes a sensor_msgs/msg/PointField"),
        ("sensor_msgs/msg/PointCloud2", {"is_dense": 1}, "is_dense takes bool"),
    ],
)
def test_what_does_not_fit_is_refused(type_name, fields, sentence):
    with pytest.raises(BagError, match=sentence):
        factory(type_name, **fields)
