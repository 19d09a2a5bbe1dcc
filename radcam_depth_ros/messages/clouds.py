"""Decodes point clouds: columns by name in any layout, and the points of a LiDAR."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.messages.wire import LARGEST_M, MessageError, data_bytes, require_fields, stamp_ns

POINT_FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's type codes of sensor_msgs/PointField's datatypes INT8 to FLOAT64."""


@dataclass(frozen=True)
class PointsReading:
    """A cloud of points.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The frame of the points.
        xyz_m: (N, 3) float32 metres, finite.
        dropped: Number of points left out since a coordinate was NaN, infinite or beyond `LARGEST_M`.
    """

    stamp_ns: int
    frame_id: str
    xyz_m: FloatArray
    dropped: int


@dataclass(frozen=True)
class CloudField:
    """One field of a cloud: its name as published, its numpy type code and where it lies within a point."""

    name: str
    type_code: str
    offset: int

    @property
    def end(self) -> int:
        """The first byte after it."""
        return self.offset + np.dtype(self.type_code).itemsize


class Cloud:
    """A sensor_msgs/PointCloud2 read in place, column by column.

    Honours offsets (unaligned ones too), datatypes, point_step, padded rows of organised clouds, and endianness. Of a
    field with a count above 1 the first value is read.

    Args:
        message: The message.

    Raises:
        MessageError: when sizes, steps and data don't agree.
    """

    def __init__(self, message: Any) -> None:
        names = ("header", "height", "width", "fields", "is_bigendian", "point_step", "row_step", "data")
        require_fields(message, "sensor_msgs/PointCloud2", *names)
        self._height, self._width = int(message.height), int(message.width)
        self.count = self._height * self._width
        """Number of points."""
        self.point_step = int(message.point_step)
        """Bytes from one point to the next."""
        self._row_step = int(message.row_step)
        self._order = ">" if message.is_bigendian else "<"
        self._data = data_bytes(message)
        self.fields = tuple(message.fields)
        """The message's sensor_msgs/PointField values."""
        if self.count:
            self._check_steps()

    def _check_steps(self) -> None:
        row_bytes = self._width * self.point_step
        if self.point_step < 1 or self._row_step < row_bytes:
            raise MessageError(
                f"expected a point cloud with a row_step of at least width x point_step = {self._width} x "
                f"{self.point_step} = {row_bytes} bytes, got {self._row_step}; the driver's steps are wrong"
            )
        needed = (self._height - 1) * self._row_step + row_bytes
        if self._data.size < needed:
            raise MessageError(
                f"expected {needed} bytes for {self._width} x {self._height} points of {self.point_step} bytes, "
                f"got {self._data.size}; the point cloud is truncated"
            )

    @property
    def field_names(self) -> str:
        """The fields' names, for a sentence."""
        return " ".join(str(field.name) for field in self.fields) or "none"

    def find(self, aliases: Iterable[str]) -> CloudField | None:
        """The field of the first alias that the cloud has, without regard to case; None when it has none.

        Raises:
            MessageError: when the field has an unknown datatype or does not fit in a point.
        """
        by_name = {str(field.name).strip().lower(): field for field in reversed(self.fields)}
        for alias in aliases:
            field = by_name.get(alias.lower())
            if field is not None:
                return self._checked(field)
        return None

    def _checked(self, field: Any) -> CloudField:
        code = POINT_FIELD_TYPES.get(int(field.datatype))
        if code is None:
            raise MessageError(
                f"expected a datatype from 1 (INT8) to 8 (FLOAT64) for the point field {field.name!r}, "
                f"got {field.datatype}; fix the driver"
            )
        found = CloudField(str(field.name), code, int(field.offset))
        if self.count and found.end > self.point_step:
            raise MessageError(
                f"expected the point field {field.name!r} within point_step {self.point_step}, got an end at byte "
                f"{found.end}; the driver's offsets or point_step are wrong"
            )
        return found

    def column(self, field: CloudField) -> npt.NDArray[Any]:
        """A field's values as they are stored, (N,); a view unless rows are padded."""
        if not self.count:
            return np.zeros(0, field.type_code)
        shape, strides = (self._height, self._width), (self._row_step, self.point_step)
        dtype = np.dtype(self._order + field.type_code)
        return np.ndarray(shape, dtype, self._data.data, field.offset, strides).reshape(-1)

    def floats(self, field: CloudField) -> FloatArray:
        """A field's values, (N,) float32 in this machine's endianness; values too large become infinite."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.column(field).astype(np.float32)


def decode_points(message: Any) -> PointsReading:
    """Reads the x y z of any sensor_msgs/PointCloud2, such as a LiDAR's.

    Raises:
        MessageError: when x, y or z is missing, or sizes, steps and data don't agree.
    """
    cloud = Cloud(message)
    xyz = np.zeros((cloud.count, 3), np.float32)
    if cloud.count:
        for axis, name in enumerate("xyz"):
            field = cloud.find((name,))
            if field is None:
                raise MessageError(
                    f"expected a point cloud with fields x y z, got {cloud.field_names}; check which topic has points"
                )
            xyz[:, axis] = cloud.floats(field)
    finite = (np.abs(xyz) < LARGEST_M).all(axis=1)  # NaN is not
    kept = xyz if bool(finite.all()) else xyz[finite]
    return PointsReading(stamp_ns(message.header), str(message.header.frame_id), kept, cloud.count - len(kept))
