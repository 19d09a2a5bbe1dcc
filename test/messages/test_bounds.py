"""What claims to be enormous is refused with a sentence before memory is taken for it."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.frame import LONGEST_SENTENCE
from radcam_depth_ros.messages import Calibration, MessageError, decode_image, decode_points, decode_radar, stamp_ns
from radcam_depth_ros.messages.picture_files import file_size, scan_count

FLAT = np.zeros((20, 30, 3), np.uint8)
KILOBYTE = np.zeros(1000, np.uint8)

PROGRESSIVE = cv2.IMWRITE_JPEG_PROGRESSIVE


def encoded(extension: str, image: np.ndarray, settings: tuple[int, ...] = ()) -> bytes:
    return cv2.imencode(extension, image, settings)[1].tobytes()


def compressed(content: bytes) -> SimpleNamespace:
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=2), frame_id="camera")
    return SimpleNamespace(header=header, format="", data=np.frombuffer(content, np.uint8))


def camera_info(**changes: Any) -> SimpleNamespace:
    k, r = np.array([150.0, 0, 81, 0, 148, 58, 0, 0, 1]), np.eye(3).reshape(-1)
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    fields = {"width": 160, "height": 120, "distortion_model": "", "d": np.zeros(0), "k": k, "r": r, "p": np.zeros(12)}
    return SimpleNamespace(**(fields | {"binning_x": 0, "binning_y": 0, "roi": roi} | changes))


@pytest.fixture
def refused() -> Callable[[str, Callable[[], Any]], None]:
    def check(words: str, call: Callable[[], Any]) -> None:
        tracemalloc.start()
        try:
            with pytest.raises(MessageError, match=words):
                call()
            assert tracemalloc.get_traced_memory()[1] < 1_000_000
        finally:
            tracemalloc.stop()

    return check


@pytest.mark.parametrize("decode", [decode_radar, decode_points])
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": 2**16, "height": 2**12, "row_step": 2**20}, "expected 4294967296 bytes .* got 12"),
        ({"width": 2**32 - 1, "height": 2**32 - 1, "row_step": 2**32 - 1}, "row_step of at least"),
        ({"point_step": 2**32 - 1, "row_step": 2**32 - 1}, "expected 4294967295 bytes .* got 12"),
    ],
)
def test_clouds_of_gigabytes(refused, cloud_message, decode, changes, words):
    message = cloud_message(("x", 7, 0, [1.0]), ("y", 7, 4, [1.0]), ("z", 7, 8, [1.0]))
    vars(message).update({"point_step": 16, **changes})
    refused(words, lambda: decode(message))


@pytest.mark.parametrize("encoding", ["rgb8", "mono8", "mono16", "bayer_rggb8", "nv12", "yuyv"])
@pytest.mark.parametrize(
    ("width", "height", "words"),
    [
        (100_000, 2, "at most 32767 pixels a side and 50000000 in all, got 100000 x 2"),
        (20_000, 20_000, "at most 32767 pixels a side and 50000000 in all, got 20000 x 20000"),
        (8000, 6000, "expected .* bytes for 8000 x 6000 pixels .* got 1000; the image is truncated"),
    ],
)
def test_images(refused, image_message, encoding, width, height, words):
    refused(words, lambda: decode_image(image_message(encoding, width, height, KILOBYTE, width * 4)))


def png_that_claims(width: int, height: int) -> bytes:
    content = bytearray(encoded(".png", FLAT))
    content[16:24] = struct.pack(">II", width, height)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    return bytes(content)


def jpeg_that_claims(width: int, height: int) -> bytes:
    content = bytearray(encoded(".jpg", FLAT))
    at = content.find(b"\xff\xc0") + 5
    content[at : at + 4] = struct.pack(">HH", height, width)
    return bytes(content)


@pytest.mark.parametrize("make", [png_that_claims, jpeg_that_claims])
@pytest.mark.parametrize("size", [(65_000, 65_000), (40_000, 1), (30_000, 30_000)])
def test_compressed_images(refused, make, size):
    refused(f"got {size[0]} x {size[1]}", lambda: decode_image(compressed(make(*size))))


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from([(".jpg", ()), (".jpg", (PROGRESSIVE, 1)), (".png", ())]),
    st.integers(1, 300),
    st.integers(1, 300),
    st.binary(max_size=30).filter(lambda text: not text.startswith(b"\xff")),
)
def test_the_size_of_a_file_is_read_without_decoding_it(kind, width, height, comment):
    extension, how = kind
    content = encoded(extension, np.zeros((height, width, 3), np.uint8), how)
    if extension == ".jpg":  # filling before a mark, and a comment that looks like a frame header
        segment = comment + b"\xff\xc0\x00\x11\x08\x00\x01\x00\x01\x03"
        content = content[:2] + b"\xff\xff\xfe" + struct.pack(">H", len(segment) + 2) + segment + content[2:]
    assert file_size(content) == (width, height)
    assert decode_image(compressed(content)).image.shape == (height, width, 3)


def test_a_jpeg_with_very_many_scans(refused):
    content = encoded(".jpg", np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8), (PROGRESSIVE, 1))
    assert 1 < scan_count(content) < 20
    start = content.rfind(b"\xff\xda")
    last = content[start : content.rfind(b"\xff\xd9")]
    refused(
        "at most 40 scans in a jpeg, got", lambda: decode_image(compressed(content[:start] + 60 * last + b"\xff\xd9"))
    )


def test_a_camera_of_another_world(refused):
    refused("at most 32767 pixels a side", lambda: Calibration(camera_info(width=100_000)))
    nearly_nothing = np.array([5e-324, 0, 1, 0, 5e-324, 1, 0, 0, 1])
    for name in ("k", "p"):
        values = nearly_nothing if name == "k" else np.insert(nearly_nothing, (3, 6, 9), 0)
        refused("positive focal lengths", lambda name=name, values=values: Calibration(camera_info(**{name: values})))
    refused("finite numbers below 1e", lambda: Calibration(camera_info(r=np.full(9, 1e200))))
    singular = np.array([150.0, 0, 80, 0, 150, 60, 0, 0, 0])
    refused("last row of 0 0 1 in camera_info's k", lambda: Calibration(camera_info(k=singular)))


def test_positions_beyond_all_roads_are_left_out_and_counted(cloud_message):
    fields = [("x", 7, 0, [3e38, 5.0]), ("y", 7, 4, [0.0, 0.0]), ("z", 7, 8, [0.0, 0.0])]
    for decode in (decode_radar, decode_points):
        assert decode(cloud_message(*fields)).dropped == 1


def test_a_second_of_more_than_a_second():
    stamp = SimpleNamespace(sec=2**31 - 1, nanosec=1_000_000_000)
    with pytest.raises(MessageError, match="0 to 999999999 nanoseconds, got 1000000000"):
        stamp_ns(SimpleNamespace(stamp=stamp))


def test_a_sentence_is_short_whatever_came(image_message):
    with pytest.raises(MessageError) as raised:
        decode_image(image_message("x" * 1_000_000, 8, 6, b"", 24))
    sentence = str(raised.value)
    assert len(sentence) <= LONGEST_SENTENCE
    assert sentence.startswith("expected an image of encoding")
    assert sentence.endswith("change the driver's encoding or choose the colour topic")
