"""The dense depth as it is published: without the sky."""

from __future__ import annotations

import numpy as np
import pytest
from small_drive import CAMERA, START_NS, small_image

from radcam_depth_ros.bags import factory
from radcam_depth_ros.encoder import Encoder, EncoderError, OutputConfig
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame, GroundPlane, RadarReturns
from radcam_depth_ros.messages import decode_depth


def encoded(config: OutputConfig, sky: FloatArray | None, *wanted: str) -> dict[str, object]:
    """Messages of a frame whose depth is 5 m everywhere."""
    shape = (CAMERA.height, CAMERA.width)
    frame = Frame(START_NS, "camera", small_image(0), CAMERA, RadarReturns.empty(), GroundPlane())
    dense, confidence = np.full(shape, 5.0, np.float32), np.ones(shape, np.float32)
    result = DepthResult(START_NS, "camera", CAMERA, dense, np.full_like(dense, np.nan), confidence, 0, None, sky)
    return Encoder(config, factory).encode(frame, result, wanted)


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
    millimetres = np.frombuffer(bytes(messages["depth"].data), np.uint16).reshape(CAMERA.height, CAMERA.width)  # type: ignore[attr-defined]
    assert (millimetres[: CAMERA.height // 2] == 0).all()
    assert (millimetres[CAMERA.height // 2 :] == 5000).all()
    assert messages["points"].width == (CAMERA.height - CAMERA.height // 2) * CAMERA.width  # type: ignore[attr-defined]


def test_a_network_that_does_not_tell_the_sky_has_depth_everywhere() -> None:
    assert np.isfinite(decode_depth(encoded(OutputConfig(), None, "depth")["depth"]).depth_m).all()


def test_another_word_for_the_sky_is_refused() -> None:
    with pytest.raises(EncoderError, match="sky"):
        OutputConfig(sky="blue")
