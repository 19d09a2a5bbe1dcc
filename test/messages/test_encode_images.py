from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.messages import (
    COLORMAPS,
    Calibration,
    MessageError,
    colorise,
    decode_classes,
    decode_depth,
    decode_image,
    encode_camera_info,
    encode_compressed_image,
    encode_confidence,
    encode_depth,
    encode_image,
    encode_preview,
)

STAMP = 1_700_000_000_123_456_789
SHAPES = npst.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9)
METRES = st.one_of(
    st.just(np.float32(np.nan)), st.just(np.float32(np.inf)), st.floats(np.float32(1e-3), np.float32(300), width=32)
)


@settings(max_examples=30, deadline=None)
@given(depth=npst.arrays(np.float32, SHAPES, elements=METRES))
def test_depth_in_metres_comes_back(maker, depth):
    message = maker.send(encode_depth(maker.make, depth, STAMP, "camera"), "sensor_msgs/msg/Image")
    reading = decode_depth(message)
    np.testing.assert_array_equal(reading.depth_m, depth)
    assert (reading.stamp_ns, reading.frame_id, message.encoding) == (STAMP, "camera", "32FC1")


@settings(max_examples=30, deadline=None)
@given(depth=npst.arrays(np.float32, SHAPES, elements=METRES))
def test_depth_in_millimetres_comes_back_and_never_wraps(maker, depth):
    message = maker.send(encode_depth(maker.make, depth, STAMP, "camera", "16UC1"), "sensor_msgs/msg/Image")
    decoded = decode_depth(message).depth_m
    kept = (depth >= 0.0006) & (depth <= 65.535)
    np.testing.assert_allclose(decoded[kept], depth[kept], atol=0.00051)
    assert np.isnan(decoded[~kept & ~(depth < 0.0006)]).all()


def test_limits_of_millimetres(make):
    depth = np.array(
        [[0.0, -1.0, np.nan, np.inf, -np.inf, 65.535, 65.5354, 65.536, 70.0, 1e9, 1e30, 0.0006]], np.float32
    )
    message = encode_depth(make, depth, STAMP, "camera", "16UC1")
    assert message.data.view(np.uint16).tolist() == [0, 0, 0, 0, 0, 65535, 0, 0, 0, 0, 0, 1]
    assert (message.step, message.width, message.height) == (24, 12, 1)


@settings(max_examples=20, deadline=None)
@given(image=npst.arrays(np.uint8, SHAPES.map(lambda shape: (*shape, 3))))
def test_images_come_back(maker, image):
    message = maker.send(encode_image(maker.make, image, STAMP, "camera"), "sensor_msgs/msg/Image")
    reading = decode_image(message)
    np.testing.assert_array_equal(reading.image, image)
    assert (reading.stamp_ns, reading.frame_id) == (STAMP, "camera")
    assert np.shares_memory(reading.image, np.frombuffer(message.data, np.uint8))


@settings(max_examples=20, deadline=None)
@given(classes=npst.arrays(np.uint8, SHAPES))
def test_class_images_come_back(maker, classes):
    message = maker.send(encode_image(maker.make, classes, STAMP, "camera"), "sensor_msgs/msg/Image")
    np.testing.assert_array_equal(decode_classes(message).classes, classes)


def test_confidence_comes_back(maker):
    confidence = np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4)
    message = maker.send(encode_confidence(maker.make, confidence, STAMP, "camera"), "sensor_msgs/msg/Image")
    assert message.encoding == "32FC1"
    np.testing.assert_array_equal(np.frombuffer(message.data, np.float32), confidence.reshape(-1))


@pytest.mark.parametrize("image", [np.full((16, 24, 3), (200, 100, 40), np.uint8), np.full((16, 24), 90, np.uint8)])
def test_compressed_images_come_back(maker, image):
    message = encode_compressed_image(maker.make, image, STAMP, "camera", quality=95)
    reading = decode_image(maker.send(message, "sensor_msgs/msg/CompressedImage"))
    expected = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    np.testing.assert_allclose(reading.image.astype(int), expected, atol=4)
    assert (reading.stamp_ns, reading.frame_id) == (STAMP, "camera")


@settings(max_examples=20, deadline=None)
@given(
    size=st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
    focal=st.tuples(st.floats(1, 5000), st.floats(1, 5000)),
    centre=st.tuples(st.floats(-100, 4000), st.floats(-100, 4000)),
)
def test_camera_infos_come_back(maker, size, focal, centre):
    camera = CameraModel(*size, *focal, *centre)
    message = encode_camera_info(maker.make, camera, STAMP, "camera")
    calibration = Calibration(maker.send(message, "sensor_msgs/msg/CameraInfo"))
    assert calibration.camera == camera
    assert calibration.lens is None
    assert calibration.matches(message)


def test_contiguous_arrays_are_not_copied(make):
    depth, image = np.ones((4, 6), np.float32), np.ones((4, 6, 3), np.uint8)
    assert np.shares_memory(encode_depth(make, depth, STAMP, "camera").data, depth)
    assert np.shares_memory(encode_image(make, image, STAMP, "camera").data, image)


def test_slices_are_written_whole(make):
    depth = np.arange(1, 49, dtype=np.float32).reshape(6, 8)[::2, 1:5]
    for encoding in ("32FC1", "16UC1"):
        np.testing.assert_array_equal(decode_depth(encode_depth(make, depth, STAMP, "camera", encoding)).depth_m, depth)


def test_preview(maker):
    depth = np.array([[1.0, 4.0, 20.0, 80.0], [0.5, 200.0, np.inf, np.nan], [0.0, -3.0, 1.0, 1.0]], np.float32)
    message = maker.send(encode_preview(maker.make, depth, 1.0, 80.0, STAMP, "camera"), "sensor_msgs/msg/Image")
    assert message.encoding == "rgb8"
    image = decode_image(message).image.astype(int)
    near, far = image[0, 0], image[0, 3]
    assert near[0] > 3 * near[2]  # red
    assert far[2] > far[0]  # blue
    assert (image[1, 0] == near).all()
    assert (image[1, 1:3] == far).all()
    assert (image[1, 3] == 0).all()
    assert (image[2, :2] == 0).all()
    # Black is kept for "no value".
    assert (colorise(np.geomspace(0.1, 1000, 500, dtype=np.float32)[None], 1.0, 80.0).sum(axis=2) > 0).all()


@pytest.mark.parametrize("colormap", COLORMAPS)
def test_previews_of_all_colours_tell_near_from_far_and_keep_black(colormap):
    depth = np.geomspace(0.1, 1000, 500, dtype=np.float32)[None]
    depth[0, 0] = np.nan
    colours = colorise(depth, 1.0, 80.0, colormap)[0]
    assert (colours[0] == 0).all()
    assert (colours[1:].sum(axis=1) > 0).all()
    assert len(np.unique(colours, axis=0)) > 120
    assert (colours[1] != colours[-1]).any()


def test_colours_that_there_are_not_are_refused():
    with pytest.raises(MessageError, match=r"expected the colours turbo, .* got 'pink'"):
        colorise(np.ones((2, 2), np.float32), 1.0, 80.0, "pink")


@pytest.mark.parametrize(("near", "far"), [(0.0, 80.0), (5.0, 5.0), (1.0, np.inf), (np.nan, 80.0)])
def test_preview_refuses_an_empty_range(near, far):
    with pytest.raises(MessageError, match="0 < near < far"):
        colorise(np.ones((2, 2), np.float32), near, far)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda make: encode_depth(make, np.ones((2, 2)), STAMP, "c"), ["(H, W) float32", "float64"]),
        (
            lambda make: encode_depth(make, np.ones((2, 2), np.float32), STAMP, "c", "64FC1"),
            ["32FC1 or 16UC1", "64FC1"],
        ),
        (lambda make: encode_depth(make, np.ones((0, 2), np.float32), STAMP, "c"), ["(0, 2)"]),
        (lambda make: encode_confidence(make, np.ones(4, np.float32), STAMP, "c"), ["(H, W) float32", "(4,)"]),
        (lambda make: encode_image(make, np.ones((2, 2, 4), np.uint8), STAMP, "c"), ["(H, W, 3)", "(2, 2, 4)"]),
        (lambda make: encode_image(make, np.ones((2, 2), np.uint16), STAMP, "c"), ["uint8", "uint16"]),
        (lambda make: encode_compressed_image(make, np.ones((2, 2), np.uint8), STAMP, "c", 0), ["1 to 100", "got 0"]),
    ],
)
def test_arrays_of_another_kind_are_refused(make, call, words):
    with pytest.raises(MessageError) as raised:
        call(make)
    for word in words:
        assert word in str(raised.value)
