"""Encodes point clouds: depth as coloured points, and arbitrary columns."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray
from radcam_depth_ros.messages.clouds import POINT_FIELD_TYPES
from radcam_depth_ros.messages.wire import MessageError, MessageFactory, flat_bytes, make_header

_DATATYPES = {np.dtype(code): datatype for datatype, code in POINT_FIELD_TYPES.items()}
_BAND_ROWS = 64
_FLOAT32 = _DATATYPES[np.dtype(np.float32)]
CLOUD_FIELDS = ("x", "y", "z", "rgb", "confidence")
"""Fields of a cloud of depth, in their order."""


def encode_cloud(
    factory: MessageFactory,
    depth: FloatArray,
    image: ImageArray,
    confidence: FloatArray,
    camera: CameraModel,
    stamp_ns: int,
    frame_id: str,
    *,
    stride: int = 1,
    near_m: float = 0.0,
    far_m: float = math.inf,
    min_confidence: float = 0.0,
    organized: bool = False,
) -> Any:
    """Writes depth as a sensor_msgs/PointCloud2 of `CLOUD_FIELDS`, float32 each, in the camera's optical frame.

    `rgb` is what PCL and RViz expect: the bytes of 0x00RRGGBB, declared as float32.

    Args:
        factory: Builds the message.
        depth: (H, W) float32 metres; pixels that are not finite and positive give no point.
        image: (H, W, 3) uint8 RGB.
        confidence: (H, W) float32, 0 to 1; NaN counts as 0.
        camera: The ideal camera of all three.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        stride: Every so many columns and rows give points, those in the middle of each such square.
        near_m: Minimum depth of a point.
        far_m: Maximum depth of a point; +inf gives none.
        min_confidence: Minimum confidence of a point.
        organized: The cloud has the height and width of the image, over the stride; x y z of a pixel without a point
            are NaN. Otherwise it has a height of 1, and holds the points alone.

    Raises:
        MessageError: when the sizes of depth, image, confidence and camera differ, or for a stride below 1.
    """
    _check_sizes(depth, image, confidence, camera)
    if stride < 1:
        raise MessageError(f"expected a stride of 1 or more for a point cloud, got {stride}")
    every = slice(min(stride // 2, camera.width - 1, camera.height - 1), None, stride)
    depth, image, confidence = depth[every, every], np.ascontiguousarray(image[every, every]), confidence[every, every]
    right = ((np.arange(camera.width)[every] - camera.cx) / camera.fx).astype(np.float32)
    down = ((np.arange(camera.height)[every] - camera.cy) / camera.fy).astype(np.float32)[:, None]
    known = (depth >= near_m if near_m > 0 else depth > 0) & (depth <= far_m if far_m < np.inf else depth < np.inf)
    if min_confidence > 0:
        known &= confidence >= np.float32(min_confidence)
    if organized:
        depth = np.where(known, depth, np.float32(np.nan))
    points = np.empty((known.size if organized else np.count_nonzero(known), len(CLOUD_FIELDS)), np.float32)
    written = 0
    # Band by band: temporaries of the whole image would cost more than the work, in memory new to the process.
    for first in range(0, len(depth), _BAND_ROWS):
        band = np.s_[first : first + _BAND_ROWS]
        pixels = _coloured_points(depth[band], image[band], confidence[band], right, down[band])
        pixels = pixels.reshape(-1, len(CLOUD_FIELDS))
        kept = np.arange(len(pixels)) if organized else np.flatnonzero(known[band])
        pixels.take(kept, axis=0, out=points[written : written + len(kept)], mode="clip")
        written += len(kept)
    fields = [(name, 4 * index, _FLOAT32) for index, name in enumerate(CLOUD_FIELDS)]
    is_dense = not organized or bool(known.all())
    shaped = points.reshape(*depth.shape, -1) if organized else points
    return _cloud(factory, fields, shaped, 4 * len(fields), stamp_ns, frame_id, is_dense=is_dense)


def _check_sizes(depth: FloatArray, image: ImageArray, confidence: FloatArray, camera: CameraModel) -> None:
    size = (camera.height, camera.width)
    for what, array, shape, dtype in (
        ("depth", depth, size, np.float32),
        ("image", image, (*size, 3), np.uint8),
        ("confidence", confidence, size, np.float32),
    ):
        if array.shape != shape or array.dtype != dtype:
            raise MessageError(
                f"expected {what} {shape} {np.dtype(dtype)} for a point cloud as the camera says, got {array.shape} "
                f"{array.dtype}"
            )


def _coloured_points(
    depth: FloatArray, image: ImageArray, confidence: FloatArray, right: FloatArray, down: FloatArray
) -> FloatArray:
    """Of every pixel, (H, W, 5): x y z, the packed colour and the confidence."""
    # Blue, green, red and an opacity are 0xAARRGGBB read from the low byte on; the opacity is cleared, since with it
    # the float would often be NaN, which viewers drop.
    colours = cv2.cvtColor(image, cv2.COLOR_RGB2BGRA).view("<u4")[:, :, 0].astype(np.uint32) & 0x00FFFFFF
    with np.errstate(invalid="ignore", over="ignore"):
        points: FloatArray = cv2.merge([depth * right, depth * down, depth, colours.view(np.float32), confidence])
    return points


def encode_points(
    factory: MessageFactory, columns: Mapping[str, npt.NDArray[Any]], stamp_ns: int, frame_id: str
) -> Any:
    """Writes columns as a packed sensor_msgs/PointCloud2: fields in the given order, without gaps.

    Args:
        factory: Builds the message.
        columns: (N,) arrays of int8 to int32, uint8 to uint32, float32 or float64, by field name.
        stamp_ns: Nanoseconds.
        frame_id: The frame of the points.

    Raises:
        MessageError: for columns of other types or of different lengths.
    """
    lengths = {name: column.shape for name, column in columns.items()}
    if not columns or len(set(lengths.values())) != 1 or len(next(iter(lengths.values()))) != 1:
        raise MessageError(f"expected columns (N,) of one length for a point cloud, got {lengths}")
    native = {name: column.dtype.newbyteorder("=") for name, column in columns.items()}
    unknown = {name: str(dtype) for name, dtype in native.items() if dtype not in _DATATYPES}
    if unknown:
        allowed = " ".join(str(dtype) for dtype in _DATATYPES)
        raise MessageError(f"expected columns of {allowed} for a point cloud, got {unknown}; convert them")
    points = np.empty(len(next(iter(columns.values()))), np.dtype(list(native.items())))
    for name, column in columns.items():
        points[name] = column
    offsets, offset = [], 0
    for name, dtype in native.items():
        offsets.append((name, offset, _DATATYPES[dtype]))
        offset += dtype.itemsize
    is_dense = all(bool(np.isfinite(column).all()) for column in columns.values())
    return _cloud(factory, offsets, points, offset, stamp_ns, frame_id, is_dense=is_dense)


def _cloud(
    factory: MessageFactory,
    fields: list[tuple[str, int, int]],
    points: npt.NDArray[Any],
    point_step: int,
    stamp_ns: int,
    frame_id: str,
    *,
    is_dense: bool,
) -> Any:
    """A cloud of (N,) or (N, fields) points, or of (H, W, fields) points where it is organised."""
    height, width = points.shape[:2] if points.ndim == 3 else (1, len(points))
    return factory(
        "sensor_msgs/msg/PointCloud2",
        header=make_header(factory, stamp_ns, frame_id),
        height=height,
        width=width,
        fields=[
            factory("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1)
            for name, offset, datatype in fields
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=point_step,
        row_step=point_step * width,
        data=flat_bytes(points),
        is_dense=is_dense,
    )
