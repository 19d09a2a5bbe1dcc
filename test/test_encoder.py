"""The dense depth as it is published: without the sky, and without what is doubtful."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from small_drive import CAMERA, START_NS, small_image

from radcam_depth_ros.bags import factory
from radcam_depth_ros.encoder import Encoder, EncoderError, OutputConfig
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.messages import decode_depth


def encoded(
    config: OutputConfig, sky: FloatArray | None, *wanted: str, confidence: FloatArray | None = None
) -> dict[str, Any]:
    """Messages of a frame whose depth is 5 m everywhere."""
    return encode_at(Encoder(config, factory), START_NS, sky, *wanted, confidence=confidence)


def encode_at(
    encoder: Encoder, stamp_ns: int, sky: FloatArray | None, *wanted: str, confidence: FloatArray | None = None
) -> dict[str, Any]:
    shape = (CAMERA.height, CAMERA.width)
    frame = Frame(stamp_ns, "camera", small_image(0), CAMERA, RadarReturns.empty(), GroundPlane())
    dense, sure = np.full(shape, 5.0, np.float32), np.ones(shape, np.float32)
    none, given = np.full_like(dense, np.nan), sure if confidence is None else confidence
    result = DepthResult(stamp_ns, "camera", CAMERA, dense, none, given, 0, None, sky)
    return encoder.encode(frame, result, wanted)


def half_sky() -> FloatArray:
    sky = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    sky[: CAMERA.height // 2] = 0.9
    return sky


@pytest.mark.parametrize(("value", "expected"), [("infinity", np.inf), ("none", np.nan)])
def test_the_sky_has_no_finite_depth(value: str, expected: float) -> None:
    depth = decode_depth(encoded(OutputConfig(sky=value), half_sky(), "depth")["depth"]).depth_m
    np.testing.assert_array_equal(depth[: CAMERA.height // 2], expected)
    np.testing.assert_array_equal(depth[CAMERA.height // 2 :], 5.0)


def test_the_sky_is_0_in_16_bits_and_gives_no_point() -> None:
    messages = encoded(OutputConfig(depth_encoding="16UC1"), half_sky(), "depth", "points")
    millimetres = np.frombuffer(bytes(messages["depth"].data), np.uint16).reshape(CAMERA.height, CAMERA.width)
    assert (millimetres[: CAMERA.height // 2] == 0).all()
    assert (millimetres[CAMERA.height // 2 :] == 5000).all()
    assert messages["points"].width == (CAMERA.height - CAMERA.height // 2) * CAMERA.width


def test_a_network_that_does_not_tell_the_sky_has_depth_everywhere() -> None:
    assert np.isfinite(decode_depth(encoded(OutputConfig(), None, "depth")["depth"]).depth_m).all()


def test_another_word_for_the_sky_is_refused() -> None:
    with pytest.raises(EncoderError, match="sky"):
        OutputConfig(sky="blue")


def doubtful_left() -> FloatArray:
    """0.2 on the left half of the image, NaN in its last column, 0.6 elsewhere."""
    confidence = np.full((CAMERA.height, CAMERA.width), 0.6, np.float32)
    confidence[:, : CAMERA.width // 2] = 0.2
    confidence[:, -1] = np.nan
    return confidence


def test_what_is_doubtful_has_no_depth_and_no_point_and_the_sky_stays() -> None:
    config = OutputConfig(min_confidence=0.3)
    messages = encoded(config, half_sky(), "depth", "points", "confidence", confidence=doubtful_left())
    depth, middle = decode_depth(messages["depth"]).depth_m, CAMERA.width // 2
    np.testing.assert_array_equal(depth[: CAMERA.height // 2], np.inf)
    ground = depth[CAMERA.height // 2 :]
    assert np.isnan(ground[:, :middle]).all()
    assert np.isnan(ground[:, -1]).all()
    assert (ground[:, middle:-1] == 5.0).all()
    assert messages["points"].width == ground[:, middle:-1].size
    np.testing.assert_array_equal(decode_depth(messages["confidence"]).depth_m, doubtful_left())
    config = OutputConfig(min_confidence=0.3, depth_encoding="16UC1")
    millimetres = np.frombuffer(encoded(config, None, "depth", confidence=doubtful_left())["depth"].data, np.uint16)
    assert ((millimetres == 0).reshape(depth.shape) == ~(doubtful_left() >= 0.3)).all()


@pytest.mark.parametrize(("least", "kept"), [(0.0, 1.0), (0.1, 1.0), (0.3, 0.5), (0.7, 0.0)])
def test_points_have_a_threshold_of_their_own(least: float, kept: float) -> None:
    confidence = doubtful_left()
    confidence[:, -1] = 0.6
    messages = encoded(OutputConfig(points_min_confidence=least), None, "depth", "points", confidence=confidence)
    assert np.isfinite(decode_depth(messages["depth"]).depth_m).all()
    assert messages["points"].width == kept * CAMERA.width * CAMERA.height


def test_an_organised_cloud_of_a_large_stride_still_has_rows_and_columns() -> None:
    cloud = encoded(OutputConfig(points_organized=True, points_stride=64), half_sky(), "points")["points"]
    start = min(32, CAMERA.width - 1, CAMERA.height - 1)
    expected = (len(range(start, CAMERA.height, 64)), len(range(start, CAMERA.width, 64)))
    assert (cloud.height, cloud.width) == expected
    assert len(cloud.data) == cloud.height * cloud.row_step == cloud.height * cloud.width * cloud.point_step


@pytest.mark.parametrize(
    ("period_ms", "jitter_ms", "rate_hz", "expected"),
    [(100, 0, 0.0, 30), (100, 0, 5.0, 15), (100, 0, 20.0, 30), (33, 10, 10.0, 10), (100, 20, 10.0, 29)],
)
def test_clouds_come_at_most_at_a_rate(period_ms: int, jitter_ms: int, rate_hz: float, expected: int) -> None:
    encoder = Encoder(OutputConfig(points_max_rate_hz=rate_hz, points_stride=64), factory)
    shifts = np.random.default_rng(0).integers(-jitter_ms, jitter_ms + 1, 30)
    stamps_ns = [START_NS + (frame * period_ms + int(shifts[frame])) * 1_000_000 for frame in range(30)]
    found = [stamp for stamp in stamps_ns if "points" in encode_at(encoder, stamp, None, "depth", "points")]
    assert len(found) == pytest.approx(expected, abs=1 if jitter_ms else 0)
    # A looped bag begins again at once.
    assert "points" in encode_at(encoder, START_NS - 10_000_000_000, None, "points")


def test_the_compressed_depth_is_the_published_one() -> None:
    message = encoded(OutputConfig(), half_sky(), "compressed_depth")["compressed_depth"]
    assert message.format == "32FC1; compressedDepth png"
    pixels = cv2.imdecode(np.frombuffer(message.data, np.uint8)[12:], cv2.IMREAD_UNCHANGED)
    assert (pixels[: CAMERA.height // 2] == 1).all()
    assert len(np.unique(pixels[CAMERA.height // 2 :])) == 1
