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


def encode_cloud(
    factory: MessageFactory,
    depth: FloatArray,
    image: ImageArray,
    camera: CameraModel,
    stamp_ns: int,
    frame_id: str,
    *,
    stride: int = 1,
    near_m: float = 0.0,
    far_m: float = math.inf,
) -> Any:
    """Writes depth as a sensor_msgs/PointCloud2 of x y z rgb, four float32 a point, in the camera's optical frame.

    `rgb` is what PCL and RViz expect: the bytes of 0x00RRGGBB, declared as float32.

    Args:
        factory: Builds the message.
        depth: (H, W) float32 metres; pixels that are not finite and positive give no point.
        image: (H, W, 3) uint8 RGB.
        camera: The ideal camera of both.
        stamp_ns: Nanoseconds.
        frame_id: The camera's optical frame.
        stride: Every so many columns and rows give points, those in the middle of each such square.
        near_m: Minimum depth of a point.
        far_m: Maximum depth of a point; +inf gives none.

    Raises:
        MessageError: when the sizes of depth, image and camera differ, or for a stride below 1.
    """
    size = (camera.height, camera.width)
    sizes_agree = depth.shape == size and image.shape == (*size, 3)
    if not sizes_agree or depth.dtype != np.float32 or image.dtype != np.uint8:
        raise MessageError(
            f"expected depth {size} float32 and image {(*size, 3)} uint8 as the camera says, got {depth.shape} "
            f"{depth.dtype} and {image.shape} {image.dtype}"
        )
    if stride < 1:
        raise MessageError(f"expected a stride of 1 or more for a point cloud, got {stride}")
    every = slice(min(stride // 2, camera.width - 1, camera.height - 1), None, stride)
    depth, image = depth[every, every], np.ascontiguousarray(image[every, every])
    right = ((np.arange(camera.width)[every] - camera.cx) / camera.fx).astype(np.float32)
    down = ((np.arange(camera.height)[every] - camera.cy) / camera.fy).astype(np.float32)[:, None]
    known = (depth >= near_m if near_m > 0 else depth > 0) & (depth <= far_m if far_m < np.inf else depth < np.inf)
    points = np.empty((np.count_nonzero(known), 4), np.float32)
    written = 0
    # Band by band: temporaries of the whole image would cost more than the work, in memory new to the process.
    for first in range(0, len(depth), _BAND_ROWS):
        band = np.s_[first : first + _BAND_ROWS]
        kept = np.flatnonzero(known[band])
        pixels = _coloured_points(depth[band], image[band], right, down[band])
        pixels.reshape(-1, 4).take(kept, axis=0, out=points[written : written + len(kept)], mode="clip")
        written += len(kept)
    fields = [(name, 4 * index, _FLOAT32) for index, name in enumerate(("x", "y", "z", "rgb"))]
    return _cloud(factory, fields, points, 16, stamp_ns, frame_id, is_dense=True)


def _coloured_points(depth: FloatArray, image: ImageArray, right: FloatArray, down: FloatArray) -> FloatArray:
    """Of every pixel, (H, W, 4): x y z and the packed colour."""
    # Blue, green, red and an opacity are 0xAARRGGBB read from the low byte on; the opacity is cleared, since with it
    # the float would often be NaN, which viewers drop.
    colours = cv2.cvtColor(image, cv2.COLOR_RGB2BGRA).view("<u4")[:, :, 0].astype(np.uint32) & 0x00FFFFFF
    with np.errstate(invalid="ignore", over="ignore"):
        points: FloatArray = cv2.merge([depth * right, depth * down, depth, colours.view(np.float32)])
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
    return factory(
        "sensor_msgs/msg/PointCloud2",
        header=make_header(factory, stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=[
            factory("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=datatype, count=1)
            for name, offset, datatype in fields
        ],
        is_bigendian=sys.byteorder == "big",
        point_step=point_step,
        row_step=point_step * len(points),
        data=flat_bytes(points),
        is_dense=is_dense,
    )
