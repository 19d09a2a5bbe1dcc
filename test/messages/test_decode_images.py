from __future__ import annotations

import array
import sys
import zlib
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.messages import MessageError, decode_classes, decode_depth, decode_image

RED, GREEN, BLUE = 200, 100, 40
RGB = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)


def padded(pixels: np.ndarray, padding: int) -> tuple[bytes, int]:
    rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1).view(np.uint8)
    return np.pad(rows, ((0, 0), (0, padding)), constant_values=77).tobytes(), rows.shape[1] + padding


def stored(encoding: str) -> np.ndarray:
    """RGB as an encoding stores it."""
    alpha = np.full((6, 8, 1), 9, np.uint8)
    return {
        "rgb8": RGB,
        "bgr8": RGB[..., ::-1],
        "8UC3": RGB[..., ::-1],
        "rgba8": np.concatenate([RGB, alpha], axis=2),
        "bgra8": np.concatenate([RGB[..., ::-1], alpha], axis=2),
        "RGB8": RGB,
        "Bgr8": RGB[..., ::-1],
    }[encoding]


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "8UC3", "RGB8", "Bgr8"])
def test_colour(image_message, encoding, padding):
    data, step = padded(stored(encoding), padding)
    reading = decode_image(image_message(encoding, 8, 6, data, step))
    np.testing.assert_array_equal(reading.image, RGB)
    assert reading.image.dtype == np.uint8
    assert (reading.stamp_ns, reading.frame_id) == (3_000_000_005, "sensor")


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "MONO8"])
def test_mono_becomes_three_equal_channels(image_message, encoding, padding):
    data, step = padded(RGB[..., 0], padding)
    image = decode_image(image_message(encoding, 8, 6, data, step)).image
    np.testing.assert_array_equal(image, np.repeat(RGB[..., :1], 3, axis=2))


@pytest.mark.parametrize("is_bigendian", [0, 1])
@pytest.mark.parametrize("padding", [0, 4])
def test_sixteen_bits_keep_the_upper_eight(image_message, is_bigendian, padding):
    mono = np.arange(48, dtype=np.uint16).reshape(6, 8) * 1300
    data, step = padded(mono.astype(">u2" if is_bigendian else "<u2"), padding)
    image = decode_image(image_message("mono16", 8, 6, data, step, is_bigendian)).image
    np.testing.assert_array_equal(image[..., 1], mono >> 8)
    colour = RGB.astype(np.uint16) * 256 + 13
    data, step = padded(colour.astype(">u2" if is_bigendian else "<u2"), padding)
    np.testing.assert_array_equal(decode_image(image_message("rgb16", 8, 6, data, step, is_bigendian)).image, RGB)


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_colours(image_message, pattern, padding):
    # The pattern's letters are the upper left 2 x 2 pixels row by row; the left half is one colour, the right another.
    colours = {"r": (RED, 10), "g": (GREEN, 20), "b": (BLUE, 230)}
    mosaic = np.zeros((12, 16), np.uint8)
    for index, letter in enumerate(pattern):
        row, column = divmod(index, 2)
        mosaic[row::2, column:8:2], mosaic[row::2, 8 + column :: 2] = colours[letter]
    data, step = padded(mosaic, padding)
    image = decode_image(image_message(f"bayer_{pattern}8", 16, 12, data, step)).image
    assert (image[2:-2, 2:6] == (RED, GREEN, BLUE)).all()
    assert (image[2:-2, 10:-2] == (10, 20, 230)).all()
    data, step = padded(mosaic.astype("<u2") << 8, padding)
    np.testing.assert_array_equal(decode_image(image_message(f"bayer_{pattern}16", 16, 12, data, step)).image, image)


# Y U V of BT.601's red and blue.
YUV = {"red": (81, 90, 240), "blue": (41, 240, 110)}
YUV_RGB = {"red": (255, 0, 0), "blue": (0, 0, 255)}


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("colour", ["red", "blue"])
@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuv422_yuy2", "yuyv", "nv12", "nv21", "NV12"])
def test_yuv(image_message, encoding, colour, padding):
    y, u, v = YUV[colour]
    if encoding.lower().startswith("nv"):
        pair = (u, v) if encoding.lower() == "nv12" else (v, u)
        pixels = np.concatenate([np.full((4, 6), y), np.tile(pair, (2, 3))]).astype(np.uint8)
    else:
        group = (u, y, v, y) if encoding in ("yuv422", "uyvy") else (y, u, y, v)
        pixels = np.tile(np.array(group, np.uint8), (4, 3))
    data, step = padded(pixels, padding)
    image = decode_image(image_message(encoding, 6, 4, data, step)).image
    assert image.shape == (4, 6, 3)
    np.testing.assert_allclose(image.reshape(-1, 3), np.tile(YUV_RGB[colour], (24, 1)), atol=4)


@pytest.mark.parametrize("holder", [lambda b: array.array("B", b), lambda b: np.frombuffer(b, np.uint8), bytearray])
def test_rgb_shares_memory(image_message, holder):
    data = holder(RGB.tobytes())
    image = decode_image(image_message("rgb8", 8, 6, data, 24)).image
    assert np.shares_memory(image, np.frombuffer(data, np.uint8))
    assert image.flags.c_contiguous
    np.testing.assert_array_equal(image, RGB)


def test_the_last_row_may_lack_its_padding(image_message):
    data, step = padded(RGB, 5)
    np.testing.assert_array_equal(decode_image(image_message("rgb8", 8, 6, data[:-5], step)).image, RGB)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"encoding": "32FC1"}, ["32FC1", "rgb8", "bayer_rggb8", "nv12"]),
        ({"encoding": ""}, ["''"]),
        ({"step": 23}, ["at least 24", "got 23"]),
        ({"step": 0}, ["at least 24", "got 0"]),
        ({"data": RGB.tobytes()[:-1]}, ["144 bytes", "got 143", "truncated"]),
        ({"data": b""}, ["144 bytes", "got 0"]),
        ({"height": 0}, ["at least 1 x 1", "8 x 0"]),
        ({"width": 0}, ["at least 1 x 1", "0 x 6"]),
        ({"encoding": "nv12", "height": 5}, ["even", "8 x 5"]),
        ({"encoding": "nv12", "step": 8, "data": b"0" * 71}, ["72 bytes", "got 71"]),
        ({"encoding": "yuv422", "width": 7}, ["even width", "7"]),
        ({"encoding": "bayer_rggb8", "height": 1}, ["2 x 2", "8 x 1"]),
        ({"data": "text"}, ["expected bytes", "str"]),
    ],
)
def test_bad_images_are_refused_with_a_sentence(image_message, changes, words):
    message = image_message("rgb8", 8, 6, RGB.tobytes(), 24)
    vars(message).update(changes)
    with pytest.raises(MessageError) as raised:
        decode_image(message)
    for word in words:
        assert word in str(raised.value)


def test_other_messages_are_refused():
    with pytest.raises(MessageError, match=r"expected a sensor_msgs/Image, got a SimpleNamespace without header"):
        decode_image(SimpleNamespace(ranges=[1.0]))


def compressed(content: bytes, image_format: str) -> SimpleNamespace:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=2), frame_id="camera")
    return SimpleNamespace(header=header, format=image_format, data=array.array("B", content))


def encoded(extension: str, image: np.ndarray) -> bytes:
    return cv2.imencode(extension, image)[1].tobytes()


FLAT = np.full((20, 30, 3), (RED, GREEN, BLUE), np.uint8)


@pytest.mark.parametrize(
    "image_format", ["jpeg", "rgb8; jpeg compressed bgr8", "bgr8; jpeg compressed bgr8", "", "JPG"]
)
def test_jpeg(image_format):
    reading = decode_image(compressed(encoded(".jpg", FLAT[..., ::-1]), image_format))
    np.testing.assert_allclose(reading.image.astype(int), FLAT, atol=4)
    assert (reading.stamp_ns, reading.frame_id) == (1_000_000_002, "camera")


def test_jpeg_with_red_and_blue_exchanged_says_so_in_its_format():
    reading = decode_image(compressed(encoded(".jpg", FLAT), "rgb8; jpeg compressed rgb8"))
    np.testing.assert_allclose(reading.image.astype(int), FLAT, atol=4)


@pytest.mark.parametrize(
    "image_format", ["png", "bgr8; png compressed bgr8", "rgb8; png compressed", "bgr8; png compressed"]
)
def test_png_is_exact(image_format):
    image = decode_image(compressed(encoded(".png", RGB[..., ::-1]), image_format)).image
    np.testing.assert_array_equal(image, RGB)


def test_mono_png_of_sixteen_bits():
    mono = np.arange(48, dtype=np.uint16).reshape(6, 8) * 1300
    image = decode_image(compressed(encoded(".png", mono), "mono16; png compressed")).image
    np.testing.assert_allclose(image[..., 2].astype(int), mono >> 8, atol=1)


def test_jpeg_is_not_turned_by_its_orientation_tag():
    content = encoded(".jpg", FLAT)
    tag = b"MM\x00\x2a\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00"
    segment = b"Exif\x00\x00" + tag
    tagged = content[:2] + b"\xff\xe1" + (len(segment) + 2).to_bytes(2, "big") + segment + content[2:]
    assert cv2.imdecode(np.frombuffer(tagged, np.uint8), cv2.IMREAD_COLOR).shape == (30, 20, 3)
    assert decode_image(compressed(tagged, "jpeg")).image.shape == (20, 30, 3)


@pytest.mark.parametrize(
    ("content", "image_format", "words"),
    [
        (b"", "jpeg", ["jpeg or png", "0 bytes", "nothing"]),
        (b"\x00\x00\x00\x01\x67", "h264", ["jpeg or png", "'h264'", "00 00 00 01"]),
        (encoded(".jpg", FLAT)[:-20], "jpeg", ["whole jpeg", "truncated"]),
        (encoded(".png", FLAT)[:-30], "png", ["whole png", "truncated"]),
        (b"\xff\xd8nonsense\xff\xd9", "jpeg", ["whole jpeg", "damaged"]),
    ],
)
def test_bad_compressed_images_are_refused_with_a_sentence(content, image_format, words):
    with pytest.raises(MessageError) as raised:
        decode_image(compressed(content, image_format))
    for word in words:
        assert word in str(raised.value)


@settings(max_examples=50, deadline=None)
@given(st.sampled_from([".jpg", ".png"]), st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=5))
def test_damaged_files_give_an_image_or_a_sentence(extension, changes):
    content = bytearray(encoded(extension, FLAT))
    for place, value in changes:
        content[place % len(content)] = value
    # A damaged size may be any, but not so large that this test would fill the memory.
    content[:24] = encoded(extension, FLAT)[:24]
    try:
        image = decode_image(compressed(bytes(content), "jpeg")).image
    except MessageError:
        return
    assert image.ndim == 3
    assert image.shape[2] == 3


def test_a_file_that_claims_an_enormous_size_is_refused():
    header = b"IHDR" + (2**31 - 1).to_bytes(4, "big") * 2 + b"\x08\x02\x00\x00\x00"
    png = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + header + zlib.crc32(header).to_bytes(4, "big")
    with pytest.raises(
        MessageError, match="at most 32767 pixels a side and 50000000 in all, got 2147483647 x 2147483647"
    ):
        decode_image(compressed(png + bytes(4) + b"IEND" + zlib.crc32(b"IEND").to_bytes(4, "big"), "png"))


@pytest.mark.parametrize("is_bigendian", [0, 1])
@pytest.mark.parametrize("padding", [0, 3, 8])
def test_depth_in_metres(image_message, is_bigendian, padding):
    depth = np.linspace(1, 80, 48, dtype=np.float32).reshape(6, 8)
    depth[0, :2] = np.nan, np.inf
    data, step = padded(depth.astype(">f4" if is_bigendian else "<f4"), padding)
    reading = decode_depth(image_message("32FC1", 8, 6, data, step, is_bigendian))
    np.testing.assert_array_equal(reading.depth_m, depth)
    assert reading.depth_m.dtype == np.float32
    assert reading.depth_m.dtype.isnative


def test_depth_in_metres_shares_memory(image_message):
    depth = np.linspace(1, 80, 48, dtype=np.float32).reshape(6, 8)
    message = image_message("32FC1", 8, 6, depth.reshape(-1).view(np.uint8), 32, sys.byteorder == "big")
    assert np.shares_memory(decode_depth(message).depth_m, depth)


def test_depth_without_a_value_is_nan(image_message):
    depth = np.array([[0.0, -1.0, -np.inf, 2.0]], np.float32)
    message = image_message("32FC1", 4, 1, depth.tobytes(), 16, sys.byteorder == "big")
    np.testing.assert_array_equal(decode_depth(message).depth_m, np.array([[np.nan, np.nan, np.nan, 2.0]], np.float32))
    np.testing.assert_array_equal(depth, np.array([[0.0, -1.0, -np.inf, 2.0]], np.float32))


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@pytest.mark.parametrize("is_bigendian", [0, 1])
def test_depth_in_millimetres(image_message, encoding, is_bigendian):
    millimetres = np.array([[0, 1, 1500], [65535, 2000, 0]], ">u2" if is_bigendian else "<u2")
    depth = decode_depth(image_message(encoding, 3, 2, millimetres.tobytes(), 6, is_bigendian)).depth_m
    np.testing.assert_array_equal(depth, np.array([[np.nan, 0.001, 1.5], [65.535, 2.0, np.nan]], np.float32))
    assert depth.dtype == np.float32


def test_depth_of_another_encoding_is_refused(image_message):
    with pytest.raises(MessageError, match=r"32FC1 .* got 'rgb8'"):
        decode_depth(image_message("rgb8", 8, 6, RGB.tobytes(), 24))


def test_classes(image_message):
    classes = np.arange(12, dtype=np.uint8)
    image = decode_classes(image_message("mono8", 4, 3, classes, 4)).classes
    np.testing.assert_array_equal(image, classes.reshape(3, 4))
    assert np.shares_memory(image, classes)
    with pytest.raises(MessageError, match="mono8, got 'rgb8'"):
        decode_classes(image_message("rgb8", 4, 1, classes, 12))


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_any_sizes_give_an_image_or_a_sentence(image_message, data):
    encoding = data.draw(st.sampled_from(["rgb8", "mono16", "bayer_gbrg8", "yuv422", "nv12", "rgba8", "mono8"]))
    width, height, step, size = (data.draw(st.integers(0, limit)) for limit in (9, 9, 40, 400))
    message = image_message(encoding, width, height, bytes(size), step)
    try:
        image = decode_image(message).image
    except MessageError:
        return
    assert image.shape == (height, width, 3)
    assert image.dtype == np.uint8
