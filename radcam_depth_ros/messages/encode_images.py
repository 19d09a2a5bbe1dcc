"""Encodes images: depth, confidence, preview, colour, and the CameraInfo beside them."""

from __future__ import annotations

import math
import sys
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray
from radcam_depth_ros.messages.wire import MessageError, MessageFactory, flat_bytes, make_header

DEPTH_ENCODINGS = ("32FC1", "16UC1")
"""Encodings of depth images: metres with NaN for "no value", and millimetres with 0."""

_LARGEST_MILLIMETRES_M = 65.535
_GREY = "grey"
_COLORMAPS = {
    "turbo": cv2.COLORMAP_TURBO,
    "jet": cv2.COLORMAP_JET,
    "viridis": cv2.COLORMAP_VIRIDIS,
    "cividis": cv2.COLORMAP_CIVIDIS,
    "plasma": cv2.COLORMAP_PLASMA,
    "inferno": cv2.COLORMAP_INFERNO,
    "magma": cv2.COLORMAP_MAGMA,
}
COLORMAPS = (*_COLORMAPS, _GREY)
"""Names of the colours that depth can be drawn in, of which near has the last (in turbo red, in the others light)."""


def encode_depth(
    factory: MessageFactory, depth: FloatArray, stamp_ns: int, frame_id: str, encoding: str = "32FC1"
) -> Any:
    """Writes a depth image (REP 118).

    Args:
        factory: Builds the message.
        depth: (H, W) float32 metres; NaN for "no value", +inf beyond the range. As 32FC1 it is not copied.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        encoding: "32FC1" metres, or "16UC1" millimetres: what is no positive number or more than 65.535 m becomes 0,
            which means "no value".

    Raises:
        MessageError: for another encoding, or an array that is not (H, W) float32.
    """
    return _image(factory, depth_pixels(depth, encoding), encoding, stamp_ns, frame_id)


def depth_pixels(depth: FloatArray, encoding: str) -> npt.NDArray[Any]:
    """The pixels of a depth image, (H, W), as `encode_depth` writes them: float32 metres or uint16 millimetres."""
    _require(depth, "depth image", np.float32, 2)
    if encoding not in DEPTH_ENCODINGS:
        raise MessageError(f"expected the depth encoding {' or '.join(DEPTH_ENCODINGS)}, got {encoding!r}")
    return depth if encoding == "32FC1" else _millimetres(depth)


def _millimetres(depth: FloatArray) -> npt.NDArray[np.uint16]:
    # Both steps are vectorised and the second saturates: NaN, -inf and negative depths become 0.
    _, within = cv2.threshold(np.ascontiguousarray(depth), _LARGEST_MILLIMETRES_M, 0, cv2.THRESH_TOZERO_INV)
    millimetres: npt.NDArray[np.uint16] = cv2.multiply(within, 1000.0, dtype=cv2.CV_16U)
    return millimetres


def encode_confidence(factory: MessageFactory, confidence: FloatArray, stamp_ns: int, frame_id: str) -> Any:
    """Writes a confidence image, (H, W) float32 from 0 to 1, as 32FC1 without copying.

    Raises:
        MessageError: for an array that is not (H, W) float32.
    """
    _require(confidence, "confidence image", np.float32, 2)
    return _image(factory, confidence, "32FC1", stamp_ns, frame_id)


def encode_preview(
    factory: MessageFactory,
    depth: FloatArray,
    near_m: float,
    far_m: float,
    stamp_ns: int,
    frame_id: str,
    colormap: str = "turbo",
) -> Any:
    """Writes depth in colours, see `colorise`, as rgb8."""
    return encode_image(factory, colorise(depth, near_m, far_m, colormap), stamp_ns, frame_id)


def colorise(depth: FloatArray, near_m: float, far_m: float, colormap: str = "turbo") -> ImageArray:
    """Depth in colours, of turbo by default: near is red, far is blue; equal ratios of depth are equal steps of colour.

    Args:
        depth: (H, W) float32 metres.
        near_m: Depth of the nearest colour; smaller depths have it too.
        far_m: Depth of the farthest colour; larger depths, +inf included, have it too.
        colormap: One of `COLORMAPS`.

    Returns:
        (H, W, 3) uint8 RGB, black where depth is NaN or not positive.

    Raises:
        MessageError: for a range that is not 0 < near < far, an array that is not (H, W) float32, or other colours.
    """
    _require(depth, "depth image", np.float32, 2)
    if not 0 < near_m < far_m < np.inf:
        raise MessageError(f"expected a range with 0 < near < far, got near={near_m} m far={far_m} m")
    known = depth > 0
    within = np.clip(np.where(known, depth, np.float32(far_m)), np.float32(near_m), np.float32(far_m))
    table = _color_table(colormap)
    # Entry 0 of the table is black and kept for "no value": the colours are entries 1 (far) to 255 (near).
    scale = 254.0 / math.log(far_m / near_m)
    entries = (1.5 + scale * (math.log(far_m) - cv2.log(within))).astype(np.uint8)
    entries[~known] = 0
    coloured: ImageArray = cv2.applyColorMap(entries, table)
    return coloured


def _color_table(colormap: str) -> ImageArray:
    """(256, 1, 3) uint8 RGB, black first, then from the farthest to the nearest colour."""
    ramp = np.arange(256, dtype=np.uint8).reshape(256, 1)
    if colormap == _GREY:
        return np.repeat(ramp[..., None], 3, axis=2)
    if colormap not in _COLORMAPS:
        raise MessageError(f"expected the colours {', '.join(COLORMAPS)}, got {colormap!r}")
    table: ImageArray = cv2.cvtColor(cv2.applyColorMap(ramp, _COLORMAPS[colormap]), cv2.COLOR_BGR2RGB)
    table[0] = 0
    return table


def encode_image(factory: MessageFactory, image: ImageArray, stamp_ns: int, frame_id: str) -> Any:
    """Writes an image without copying: (H, W, 3) uint8 as rgb8, (H, W) uint8 as mono8.

    Raises:
        MessageError: for an array of another shape or type.
    """
    _require(image, "image", np.uint8, 2, 3)
    return _image(factory, image, "rgb8" if image.ndim == 3 else "mono8", stamp_ns, frame_id)


def encode_compressed_image(
    factory: MessageFactory, image: ImageArray, stamp_ns: int, frame_id: str, quality: int = 90
) -> Any:
    """Writes a sensor_msgs/CompressedImage as jpeg, with the format string of image_transport.

    Args:
        factory: Builds the message.
        image: (H, W, 3) uint8 RGB or (H, W) uint8.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        quality: Of the jpeg, 1 to 100.

    Raises:
        MessageError: for an array of another shape or type, or another quality.
    """
    _require(image, "image", np.uint8, 2, 3)
    if not 1 <= quality <= 100:
        raise MessageError(f"expected a jpeg quality from 1 to 100, got {quality}")
    blue_first = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    _, content = cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return encode_jpeg_file(factory, flat_bytes(content), stamp_ns, frame_id, is_color=image.ndim == 3)


def encode_jpeg_file(
    factory: MessageFactory, content: bytes | ImageArray, stamp_ns: int, frame_id: str, *, is_color: bool = True
) -> Any:
    """Writes a JPEG's own bytes as a sensor_msgs/CompressedImage, with the format string of image_transport.

    Args:
        factory: Builds the message.
        content: The file, bytes or (N,) uint8.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        is_color: Whether it has three channels, else one.
    """
    return factory(
        "sensor_msgs/msg/CompressedImage",
        header=make_header(factory, stamp_ns, frame_id),
        format="rgb8; jpeg compressed bgr8" if is_color else "mono8; jpeg compressed mono8",
        data=content,
    )


def encode_camera_info(factory: MessageFactory, camera: CameraModel, stamp_ns: int, frame_id: str) -> Any:
    """Writes the sensor_msgs/CameraInfo of an ideal camera: no distortion, no rotation, P from K."""
    region = factory("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return factory(
        "sensor_msgs/msg/CameraInfo",
        header=make_header(factory, stamp_ns, frame_id),
        height=int(camera.height),
        width=int(camera.width),
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.ascontiguousarray(camera.matrix.reshape(-1)),
        r=np.eye(3).reshape(-1),
        p=np.hstack([camera.matrix, np.zeros((3, 1))]).reshape(-1),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def _image(factory: MessageFactory, image: npt.NDArray[Any], encoding: str, stamp_ns: int, frame_id: str) -> Any:
    height, width = image.shape[:2]
    return factory(
        "sensor_msgs/msg/Image",
        header=make_header(factory, stamp_ns, frame_id),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(sys.byteorder == "big"),
        step=image.nbytes // height,
        data=flat_bytes(image),
    )


def _require(image: npt.NDArray[Any], what: str, dtype: type[np.generic], *dimensions: int) -> None:
    """An array of the wrong kind is refused here: a message made from it would only fail in the receiver."""
    if (
        image.dtype != dtype
        or image.ndim not in dimensions
        or 0 in image.shape
        or (image.ndim == 3 and image.shape[2] != 3)
    ):
        shapes = " or ".join("(H, W, 3)" if count == 3 else "(H, W)" for count in dimensions)
        raise MessageError(f"expected a {what} of {shapes} {dtype.__name__}, got {image.shape} {image.dtype}")
