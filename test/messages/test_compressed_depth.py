"""Depth in the form of image_transport's compressedDepth, read as compressed_depth_image_transport reads it."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from radcam_depth_ros.messages import MessageError, decode_depth, encode_compressed_depth, encode_depth

STAMP = 12_000_000_034
TYPE = "sensor_msgs/msg/CompressedImage"
HEADER = struct.Struct("<iff")
ANY_DEPTH = st.floats(0.25, 256, width=32) | st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 2.0**-30, 2.0**127])


def read(message):
    """The depth image: its encoding before the semicolon, a header of 12 bytes, a PNG of 16 bits."""
    encoding, rest = message.format.split(";")
    assert rest == " compressedDepth png"
    content = np.frombuffer(bytes(message.data), np.uint8)
    kind, a, b = HEADER.unpack(content[: HEADER.size].tobytes())
    assert kind == 0
    stored = cv2.imdecode(content[HEADER.size :], cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    if encoding == "16UC1":
        assert (a, b) == (0.0, 0.0)
        return stored
    with np.errstate(divide="ignore"):
        depth = np.float32(a) / (stored.astype(np.float32) - np.float32(b))
    return np.where(stored == 0, np.float32(np.nan), depth)


@settings(max_examples=20, deadline=None)
@given(depth=npst.arrays(np.float32, (4, 6), elements=ANY_DEPTH))
def test_metres_come_back(maker, depth):
    message = maker.send(encode_compressed_depth(maker.make, depth, STAMP, "camera"), TYPE)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (12, 34, "camera")
    back = read(message)
    is_usual = (depth >= 0.25) & (depth <= 256)
    # Half a step of the inverse depth; 0.4 % at 80 m.
    allowed = np.square(depth[is_usual]) / 10_100 / 2 * 1.05 + 1e-4
    assert (np.abs(back[is_usual] - depth[is_usual]) <= allowed).all()
    np.testing.assert_array_equal(np.isposinf(back), depth > 20_000)
    np.testing.assert_array_equal(np.isnan(back), ~(depth > 0))
    np.testing.assert_allclose(back[depth == 2.0**-30], 10_100 / 65_534, rtol=1e-6)


@settings(max_examples=20, deadline=None)
@given(depth=npst.arrays(np.float32, (4, 6), elements=ANY_DEPTH))
def test_millimetres_come_back_as_they_are(maker, depth):
    message = maker.send(encode_compressed_depth(maker.make, depth, STAMP, "camera", "16UC1"), TYPE)
    raw = encode_depth(maker.make, depth, STAMP, "camera", "16UC1")
    np.testing.assert_array_equal(read(message), np.frombuffer(bytes(raw.data), np.uint16).reshape(4, 6))


def test_it_is_smaller_than_the_image(make):
    depth = np.tile(np.geomspace(80, 4, 400, dtype=np.float32)[:, None], (1, 300))
    raw, small = encode_depth(make, depth, STAMP, "camera"), encode_compressed_depth(make, depth, STAMP, "camera")
    assert len(small.data) < len(raw.data) / 10
    assert np.nanmax(np.abs(read(small) / decode_depth(raw).depth_m - 1)) < 0.005


def test_other_pixels_and_other_encodings_are_refused(make):
    with pytest.raises(MessageError, match="32FC1 or 16UC1, got '8UC1'"):
        encode_compressed_depth(make, np.ones((2, 2), np.float32), STAMP, "camera", "8UC1")
    with pytest.raises(MessageError, match=r"expected a depth image of \(H, W\) float32, got \(2, 2\) float64"):
        encode_compressed_depth(make, np.ones((2, 2)), STAMP, "camera")


def test_an_opencv_without_png_is_named(make, monkeypatch):
    monkeypatch.setattr(cv2, "haveImageWriter", lambda _: False)
    with pytest.raises(MessageError, match=r"expected an OpenCV that writes PNG .* install"):
        encode_compressed_depth(make, np.ones((2, 2), np.float32), STAMP, "camera")
