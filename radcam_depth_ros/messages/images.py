"""Decodes images: colour, compressed, depth and class images."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.messages.picture_files import file_size, scan_count
from radcam_depth_ros.messages.wire import MessageError, check_image_size, data_bytes, require_fields, stamp_ns

_IMAGE_TYPE = "sensor_msgs/Image"
_BYTE = np.dtype(np.uint8)

MOST_SCANS = 40
"""Of a JPEG: encoders make 10 of a progressive one."""


@dataclass(frozen=True)
class ImageReading:
    """A colour image.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        image: (H, W, 3) uint8 RGB. It may share the message's memory: read-only where that is, rows may be padded.
    """

    stamp_ns: int
    frame_id: str
    image: ImageArray


@dataclass(frozen=True)
class DepthReading:
    """A depth image.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        depth_m: (H, W) float32 metres along the optical axis; NaN where there is no value, +inf beyond the range.
            It may share the message's memory.
    """

    stamp_ns: int
    frame_id: str
    depth_m: FloatArray


@dataclass(frozen=True)
class ClassReading:
    """An image of class numbers.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        classes: (H, W) uint8. It may share the message's memory.
    """

    stamp_ns: int
    frame_id: str
    classes: ImageArray


@dataclass(frozen=True)
class _Pixel:
    """How an encoding stores a pixel, and OpenCV's code that makes RGB of it (None: it is RGB)."""

    channels: int
    bytes_per_channel: int
    to_rgb: int | None

    @property
    def size(self) -> int:
        return self.channels * self.bytes_per_channel


# OpenCV names a Bayer pattern in two ways: COLOR_BayerRGGB2RGB by its first two rows like ROS, COLOR_BayerBG2RGB (the
# same code) by the second row and column. The former is used throughout.
_COLOUR_ORDERS = {
    "rgb": _Pixel(3, 1, None),
    "bgr": _Pixel(3, 1, cv2.COLOR_BGR2RGB),
    "rgba": _Pixel(4, 1, cv2.COLOR_RGBA2RGB),
    "bgra": _Pixel(4, 1, cv2.COLOR_BGRA2RGB),
    "mono": _Pixel(1, 1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb": _Pixel(1, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr": _Pixel(1, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg": _Pixel(1, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg": _Pixel(1, 1, cv2.COLOR_BayerGRBG2RGB),
}
_PIXELS = {
    **{f"{order}8": pixel for order, pixel in _COLOUR_ORDERS.items()},
    **{f"{order}16": _Pixel(pixel.channels, 2, pixel.to_rgb) for order, pixel in _COLOUR_ORDERS.items()},
    # Encodings without colour, as cv_bridge writes them for OpenCV's images.
    "8uc1": _COLOUR_ORDERS["mono"],
    "8uc3": _COLOUR_ORDERS["bgr"],
    "8uc4": _COLOUR_ORDERS["bgra"],
    # ROS has two names for each of these.
    "yuv422": _Pixel(2, 1, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": _Pixel(2, 1, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": _Pixel(2, 1, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": _Pixel(2, 1, cv2.COLOR_YUV2RGB_YUY2),
}
_PLANAR = {"nv12": cv2.COLOR_YUV2RGB_NV12, "nv21": cv2.COLOR_YUV2RGB_NV21}


def decode_image(message: Any) -> ImageReading:
    """Reads a sensor_msgs/Image or CompressedImage.

    Encodings are taken without regard to case: rgb, bgr, rgba, bgra, mono and bayer_* with 8 or 16 bits (of 16 the
    upper 8 are kept), yuv422 (uyvy), yuv422_yuy2 (yuyv), nv12, nv21, and 8UC1, 8UC3, 8UC4 read as mono, bgr, bgra.
    rgb8 is not copied. Compressed images are jpeg or png, recognised by their content.

    Raises:
        MessageError: for another encoding, or sizes, step and data that don't agree.
    """
    if hasattr(message, "format") and not hasattr(message, "encoding"):
        require_fields(message, "sensor_msgs/CompressedImage", "header", "data")
        image = _decompress(message)
    else:
        require_fields(message, _IMAGE_TYPE, "header", "encoding", "height", "width", "step", "data", "is_bigendian")
        image = _to_rgb(message)
    return ImageReading(stamp_ns(message.header), str(message.header.frame_id), image)


def decode_depth(message: Any) -> DepthReading:
    """Reads a depth image: 32FC1 metres or 16UC1 (mono16) millimetres.

    Zero and less becomes NaN (REP 118 has 0 for "no value" in 16UC1, REP 117 -inf for "too close"). A 32FC1 image of
    this machine's endianness without such values is not copied.

    Raises:
        MessageError: for another encoding, or sizes, step and data that don't agree.
    """
    require_fields(message, _IMAGE_TYPE, "header", "encoding", "height", "width", "step", "data", "is_bigendian")
    encoding = _encoding(message)
    if encoding == "32fc1":
        depth = _aligned(_rows(message, (*_size(message), 1), _endian(message, "f4")), np.float32)
        if bool((depth <= 0).any()):
            depth = np.where(depth > 0, depth, np.float32(np.nan))
    elif encoding in ("16uc1", "mono16"):
        millimetres = _rows(message, (*_size(message), 1), _endian(message, "u2"))
        with np.errstate(invalid="ignore"):
            depth = millimetres / ((millimetres != 0) * np.float32(1000))  # 0 / 0 is NaN, faster than a masked write
    else:
        raise MessageError(
            f"expected a depth image of encoding 32FC1 (metres) or 16UC1 (millimetres), got {message.encoding!r}; "
            "check which topic carries depth"
        )
    return DepthReading(stamp_ns(message.header), str(message.header.frame_id), depth)


def decode_classes(message: Any) -> ClassReading:
    """Reads an image of class numbers, mono8 or 8UC1, without copying.

    Raises:
        MessageError: for another encoding, or sizes, step and data that don't agree.
    """
    require_fields(message, _IMAGE_TYPE, "header", "encoding", "height", "width", "step", "data")
    if _encoding(message) not in ("mono8", "8uc1"):
        raise MessageError(
            f"expected a class image of encoding mono8, got {message.encoding!r}; check which topic carries classes"
        )
    classes: ImageArray = _rows(message, (*_size(message), 1), _BYTE)
    return ClassReading(stamp_ns(message.header), str(message.header.frame_id), classes)


def _encoding(message: Any) -> str:
    return str(message.encoding).strip().lower()


def _endian(message: Any, code: str) -> np.dtype[Any]:
    return np.dtype((">" if message.is_bigendian else "<") + code)


def _aligned(image: npt.NDArray[Any], dtype: type[np.float32]) -> npt.NDArray[np.float32]:
    """The image itself where any library can read it in place, else a copy."""
    if image.dtype == dtype and image.flags.aligned and image.strides[0] % image.itemsize == 0:
        return image
    return image.astype(dtype)


def _rows(message: Any, shape: tuple[int, int, int], dtype: np.dtype[Any], first_row: int = 0) -> Any:
    """Rows of pixels in place, padded as the step says: `shape` is (rows, columns, channels); (H, W) for 1 channel."""
    rows, columns, channels = shape
    step = int(message.step)
    if rows < 1 or columns < 1:
        raise MessageError(
            f"expected an image of at least 1 x 1 pixels, got {message.width} x {message.height}; check the driver"
        )
    check_image_size(columns, rows)
    row_bytes = columns * channels * dtype.itemsize
    if step < row_bytes:
        raise MessageError(
            f"expected a step of at least {row_bytes} bytes for {message.width} pixels of {message.encoding}, "
            f"got {step}; the driver's step or encoding is wrong"
        )
    data = data_bytes(message)
    needed = (first_row + rows - 1) * step + row_bytes  # the last row may lack its padding
    if data.size < needed:
        raise MessageError(
            f"expected {needed} bytes for {message.width} x {message.height} pixels of {message.encoding} with step "
            f"{step}, got {data.size}; the image is truncated"
        )
    strides = (step, channels * dtype.itemsize, dtype.itemsize)
    view = np.ndarray(shape, dtype, data.data, first_row * step, strides)
    return view[:, :, 0] if channels == 1 else view


def _size(message: Any) -> tuple[int, int]:
    return int(message.height), int(message.width)


def _to_rgb(message: Any) -> ImageArray:
    encoding = _encoding(message)
    if encoding in _PLANAR:
        return _planar_to_rgb(message, _PLANAR[encoding])
    pixel = _PIXELS.get(encoding)
    if pixel is None:
        raise MessageError(
            f"expected an image of encoding {', '.join(sorted(_PIXELS | _PLANAR))}, got {message.encoding!r}; "
            "change the driver's encoding or choose the colour topic"
        )
    image = _rows(message, (*_size(message), pixel.size), _BYTE)
    if pixel.bytes_per_channel == 2:
        upper = image[..., 0::2] if message.is_bigendian else image[..., 1::2]
        image = np.ascontiguousarray(upper[..., 0] if pixel.channels == 1 else upper)
    if encoding in ("yuv422", "uyvy", "yuv422_yuy2", "yuyv") and image.shape[1] % 2:
        raise MessageError(f"expected an even width for {message.encoding}, got {image.shape[1]}; crop the image")
    if encoding.startswith("bayer") and min(image.shape) < 2:
        raise MessageError(
            f"expected at least 2 x 2 pixels for {message.encoding}, got {message.width} x {message.height}"
        )
    rgb: ImageArray = image if pixel.to_rgb is None else cv2.cvtColor(image, pixel.to_rgb)
    return rgb


def _planar_to_rgb(message: Any, code: int) -> ImageArray:
    """Two planes: the brightness, then half as many rows of interleaved colour with the same step."""
    height, width = _size(message)
    if height % 2 or width % 2:
        raise MessageError(
            f"expected an even width and height for {message.encoding}, got {width} x {height}; crop the image"
        )
    brightness = _rows(message, (height, width, 1), _BYTE)
    colour = _rows(message, (height // 2, width // 2, 2), _BYTE, first_row=height)
    rgb: ImageArray = cv2.cvtColorTwoPlane(brightness, colour, code)
    return rgb


def _decompress(message: Any) -> ImageArray:
    data = data_bytes(message)
    content = data.tobytes()
    kind = "jpeg" if content.startswith(b"\xff\xd8") else "png" if content.startswith(b"\x89PNG") else None
    if kind is None:
        raise MessageError(
            f"expected a jpeg or png in a compressed image, got format {message.format!r} with {len(content)} bytes "
            f"that begin with {content[:4].hex(' ') or 'nothing'}; republish the image as jpeg, png or raw"
        )
    # OpenCV fills what is missing of a truncated file with grey and only warns: look for the end mark.
    end = b"\xff\xd9" if kind == "jpeg" else b"IEND"
    image = None
    size = file_size(content)
    if size is not None and content.rfind(end) > 0:
        check_image_size(*size)
        scans = scan_count(content) if kind == "jpeg" else 0
        if scans > MOST_SCANS:
            raise MessageError(
                f"expected at most {MOST_SCANS} scans in a jpeg, got {scans}, which would take long to decode; publish "
                "baseline jpeg"
            )
        # OpenCV raises, instead of returning None, for a header that contradicts itself.
        with contextlib.suppress(cv2.error):
            # Intrinsics belong to the image as it was taken, so an orientation tag must not turn it.
            image = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise MessageError(
            f"expected a whole {kind} file in a compressed image, got {len(content)} bytes that are truncated or "
            "damaged; check the driver and the network"
        )
    if _stores_red_first(str(message.format)):
        red_first: ImageArray = image
        return red_first
    rgb: ImageArray = cv2.cvtColor(image, cv2.COLOR_BGR2RGB, dst=image)
    return rgb


def _stores_red_first(image_format: str) -> bool:
    """Whether the file's red and blue are exchanged, as image_transport's `compressed rgb8` says.

    The compressed_image_transport plugin gives its encoder BGR and writes "...; jpeg compressed bgr8". A publisher that
    gave RGB to an encoder of BGR says "compressed rgb8", and the plugin's subscriber exchanges the two again.
    """
    return "compressed rgb" in image_format.lower()
