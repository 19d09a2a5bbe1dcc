"""Encodes depth as image_transport's `compressedDepth`: a header of 12 bytes and a PNG of 16 bits.

The header holds three little-endian values: int32 0, and the float32 A and B of the quantisation. A pixel of 32FC1 is
v = A / depth + B, rounded, so that depth is A / (v - B); 0 means "no value". 16UC1 is stored as it is, with A = B = 0.
"""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.messages.encode_images import depth_pixels
from radcam_depth_ros.messages.wire import MessageError, MessageFactory, flat_bytes, make_header

_QUANTISATION = 100.0
"""`depth_quantization` of image_transport, its default: steps of 1 cm at a depth of 10 m, 0.63 m at 80 m."""
_A = _QUANTISATION * (_QUANTISATION + 1)
_B = 1.0
"""B = 1 - A / depth_max for depth without an end: v = 1 is what lies beyond the range, +inf."""
_LARGEST = 65_535
_HEADER = "<iff"
_INVERSE_DEPTH = 0
_PNG_LEVEL = 1
"""Of zlib."""


def png_problem() -> str:
    """Why depth cannot be compressed here; empty where it can."""
    if cv2.haveImageWriter(".png"):
        return ""
    return (
        "expected an OpenCV that writes PNG for compressed depth, got one that was built without; install "
        "opencv-python-headless, or take the depth that is not compressed"
    )


def encode_compressed_depth(
    factory: MessageFactory, depth: FloatArray, stamp_ns: int, frame_id: str, encoding: str = "32FC1"
) -> Any:
    """Writes a sensor_msgs/CompressedImage that image_transport's `compressedDepth` reads.

    Args:
        factory: Builds the message.
        depth: (H, W) float32 metres; NaN for "no value", +inf beyond the range. As 32FC1 both come back; what is nearer
            than 0.16 m comes back as that, what is beyond 20 km as +inf.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        encoding: Of the depth image that comes back, as in `encode_depth`.

    Raises:
        MessageError: for another encoding, an array that is not (H, W) float32, or an OpenCV without PNG.
    """
    pixels = depth_pixels(depth, encoding)
    problem = png_problem()
    if problem:
        raise MessageError(problem)
    parameters = (0.0, 0.0)
    if pixels.dtype == np.float32:
        pixels, parameters = _inverse(pixels), (_A, _B)
    header = struct.pack(_HEADER, _INVERSE_DEPTH, *parameters)
    _, content = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, _PNG_LEVEL])
    return factory(
        "sensor_msgs/msg/CompressedImage",
        header=make_header(factory, stamp_ns, frame_id),
        format=f"{encoding}; compressedDepth png",
        data=np.concatenate([np.frombuffer(header, np.uint8), flat_bytes(content)]),
    )


def _inverse(depth: FloatArray) -> npt.NDArray[np.uint16]:
    steps = np.maximum(depth, np.float32(_A / (_LARGEST - 1)))
    np.divide(np.float32(_A), steps, out=steps)
    steps += np.float32(_B + 0.5)
    inverse: npt.NDArray[np.uint16] = np.where(depth > 0, steps, np.float32(0)).astype(np.uint16)
    return inverse
