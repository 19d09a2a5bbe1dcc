from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.messages import MessageError, decode_points, decode_radar, encode_cloud, encode_points

STAMP = 12_000_000_034
CAMERA = CameraModel(6, 4, 5.0, 4.0, 2.5, 1.5)
SURE = np.ones((4, 6), np.float32)
POSITIONS = st.floats(-200, 200, width=32)
KINDS = [np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.float32, np.float64]


@settings(max_examples=20, deadline=None)
@given(depth=npst.arrays(np.float32, (4, 6), elements=st.floats(-1, 200, width=32)), data=st.data())
def test_depth_as_coloured_points(maker, depth, data):
    depth[0, 0], depth[1, 1], depth[2, 2] = np.nan, np.inf, 0.0
    image = data.draw(npst.arrays(np.uint8, (4, 6, 3)))
    confidence = data.draw(npst.arrays(np.float32, (4, 6), elements=st.floats(0, 1, width=32)))
    message = encode_cloud(maker.make, depth, image, confidence, CAMERA, STAMP, "camera")
    message = maker.send(message, "sensor_msgs/msg/PointCloud2")
    reading = decode_points(message)
    assert (reading.stamp_ns, reading.frame_id) == (STAMP, "camera")
    rows, columns = np.nonzero((depth > 0) & np.isfinite(depth))
    np.testing.assert_array_equal(reading.xyz_m[:, 2], depth[rows, columns])
    with np.errstate(under="ignore"):
        uv = reading.xyz_m[:, :2] / reading.xyz_m[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
    regular = depth[rows, columns] > 1e-30
    np.testing.assert_allclose(uv[regular], np.stack([columns, rows], axis=1)[regular], atol=1e-4)
    # The bytes of the fourth value are blue, green, red, 0 on a little-endian machine, as in PCL.
    assert [(field.name, field.offset, field.datatype) for field in message.fields][3] == ("rgb", 12, 7)
    assert [field.name for field in message.fields] == ["x", "y", "z", "rgb", "confidence"]
    np.testing.assert_array_equal(columns_of(message)[:, 4], confidence[rows, columns])
    packed = columns_of(message).view(np.uint32)[:, 3]
    np.testing.assert_array_equal(
        np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1), image[rows, columns]
    )
    assert message.is_dense
    assert message.row_step == 20 * len(rows) == len(message.data)


def columns_of(message):
    """(N, 5) float32 of a cloud of depth: x y z, the packed colour and the confidence."""
    return np.frombuffer(message.data, np.float32).reshape(-1, 5)


def test_depth_without_values_gives_no_points(maker):
    depth = np.full((4, 6), np.nan, np.float32)
    message = encode_cloud(maker.make, depth, np.zeros((4, 6, 3), np.uint8), SURE, CAMERA, STAMP, "camera")
    assert len(decode_points(maker.send(message, "sensor_msgs/msg/PointCloud2")).xyz_m) == 0


@settings(max_examples=30, deadline=None)
@given(
    size=st.tuples(st.integers(1, 40), st.integers(1, 150)),
    stride=st.integers(1, 64),
    limits=st.tuples(st.floats(0, 500), st.floats(500, 1000)),
    min_confidence=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_a_stride_a_range_and_a_confidence_leave_points_out_and_move_none(make, size, stride, limits, min_confidence):
    width, height = size
    camera = CameraModel(width, height, 50.0, 40.0, width / 2, height / 2)
    depth = np.random.default_rng(1).uniform(0.5, 1200, (height, width)).astype(np.float32)
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
    confidence = np.random.default_rng(2).uniform(0, 1, (height, width)).astype(np.float32)
    confidence.flat[0] = np.nan
    near_m, far_m = limits
    options = {"stride": stride, "near_m": near_m, "far_m": far_m, "min_confidence": min_confidence}
    message = encode_cloud(make, depth, image, confidence, camera, STAMP, "camera", **options)
    xyz = decode_points(message).xyz_m
    start = min(stride // 2, width - 1, height - 1)
    taken = np.zeros_like(depth, bool)
    taken[start::stride, start::stride] = True
    taken &= (depth >= near_m) & (depth <= far_m)
    if min_confidence:
        taken &= confidence >= np.float32(min_confidence)
    np.testing.assert_array_equal(xyz[:, 2], depth[taken])
    rows, columns = np.nonzero(taken)
    uv = xyz[:, :2] / xyz[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    np.testing.assert_allclose(uv, np.stack([columns, rows], axis=1), atol=1e-3)
    red = columns_of(message).view(np.uint32)[:, 3] >> 16
    np.testing.assert_array_equal(red, image[..., 0][taken])
    # The organised cloud has the same points, at the places of their pixels.
    message = encode_cloud(make, depth, image, confidence, camera, STAMP, "camera", **options, organized=True)
    every = np.s_[start::stride, start::stride]
    assert (message.height, message.width) == depth[every].shape
    assert message.row_step == 20 * message.width == len(message.data) // message.height
    cells = columns_of(message).reshape(message.height, message.width, 5)
    np.testing.assert_array_equal(np.isfinite(cells[..., :3]).all(axis=2), taken[every])
    np.testing.assert_array_equal(cells[..., :3][taken[every]], xyz)
    np.testing.assert_array_equal(cells[..., 4], confidence[every])
    assert np.isnan(cells[..., :3][~taken[every]]).all()
    assert message.is_dense == taken[every].all()


def test_tall_images_keep_the_order_of_their_pixels(make):
    camera = CameraModel(5, 150, 5.0, 5.0, 2.0, 75.0)
    depth = np.arange(750, dtype=np.float32).reshape(150, 5)
    depth[60:70] = np.nan
    image = np.random.default_rng(0).integers(0, 256, (150, 5, 3), np.uint8)
    message = encode_cloud(make, depth, image, np.ones_like(depth), camera, STAMP, "camera")
    z = decode_points(message).xyz_m[:, 2]
    np.testing.assert_array_equal(z, depth[(depth > 0) & np.isfinite(depth)])
    red = columns_of(message).view(np.uint32)[:, 3] >> 16
    np.testing.assert_array_equal(red, image[..., 0].reshape(-1)[z.astype(int)])


@pytest.mark.parametrize(
    ("what", "array", "expected", "got"),
    [
        ("depth", np.ones((4, 6)), r"\(4, 6\) float32", r"\(4, 6\) float64"),
        ("image", np.zeros((5, 6, 3), np.uint8), r"\(4, 6, 3\) uint8", r"\(5, 6, 3\) uint8"),
        ("confidence", np.ones((4, 5), np.float32), r"\(4, 6\) float32", r"\(4, 5\) float32"),
    ],
)
def test_sizes_that_differ_are_refused(make, what, array, expected, got):
    arrays = {"depth": SURE, "image": np.zeros((4, 6, 3), np.uint8), "confidence": SURE, what: array}
    with pytest.raises(MessageError, match=f"expected {what} {expected} .* got {got}"):
        encode_cloud(make, **arrays, camera=CAMERA, stamp_ns=STAMP, frame_id="camera")


def test_a_stride_below_one_is_refused(make):
    depth, image = np.ones((4, 6), np.float32), np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(MessageError, match=r"stride of 1 or more .* got 0"):
        encode_cloud(make, depth, image, SURE, CAMERA, STAMP, "camera", stride=0)


@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_radar_columns_come_back(maker, data):
    count = data.draw(st.integers(0, 6))
    x, y, z, rcs, speed = (data.draw(npst.arrays(np.float32, count, elements=POSITIONS)) for _ in range(5))
    extra = data.draw(npst.arrays(data.draw(st.sampled_from(KINDS)), count, elements={"allow_nan": False}))
    columns = {"x": x, "y": y, "flag": extra, "z": z, "rcs": rcs, "radial_speed": speed}
    message = maker.send(encode_points(maker.make, columns, STAMP, "radar"), "sensor_msgs/msg/PointCloud2")
    assert message.point_step == 20 + extra.itemsize
    assert [field.name for field in message.fields] == list(columns)
    reading = decode_radar(message)
    assert (reading.stamp_ns, reading.frame_id) == (STAMP, "radar")
    np.testing.assert_array_equal(reading.returns.xyz_m, np.stack([x, y, z], axis=1))
    np.testing.assert_array_equal(reading.returns.rcs_dbsm, rcs)
    np.testing.assert_array_equal(reading.returns.radial_speed_mps, speed)


def test_the_layout_is_packed_in_the_given_order(make):
    columns = {"x": np.ones(2, np.float32), "id": np.ones(2, np.int16), "flag": np.ones(2, np.int8), "t": np.ones(2)}
    message = encode_points(make, columns, STAMP, "radar")
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    assert fields == [("x", 0, 7, 1), ("id", 4, 3, 1), ("flag", 6, 1, 1), ("t", 7, 8, 1)]
    assert (message.point_step, message.row_step, message.width, message.height) == (15, 30, 2, 1)
    assert message.is_dense
    assert not encode_points(make, {"x": np.array([np.nan], np.float32)}, STAMP, "radar").is_dense


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({}, "one length"),
        ({"x": np.ones(2), "y": np.ones(3)}, "one length"),
        ({"x": np.ones((2, 2))}, "one length"),
        ({"x": np.ones(2, np.int64)}, "'x': 'int64'"),
        ({"x": np.ones(2, bool)}, "'x': 'bool'"),
    ],
)
def test_columns_that_no_cloud_can_hold_are_refused(make, columns, words):
    with pytest.raises(MessageError, match=words):
        encode_points(make, columns, STAMP, "radar")
