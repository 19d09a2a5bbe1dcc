"""Builds ROS 2 messages without ROS, with the defaults that rosbags' own constructors lack."""

from __future__ import annotations

import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from radcam_depth_ros.bags.definitions import MessageType
from radcam_depth_ros.bags.errors import BagError, nearest

_FILLER = "structure_needs_at_least_one_member"  # of an empty message; set by rosbags itself
_DTYPES = {"bool": np.dtype(np.bool_), "char": np.dtype(np.uint8), "byte": np.dtype(np.uint8)}
# The .msg files' own defaults, which rosbags does not keep: the only ones in sensor, geometry and nav messages.
_DEFAULTS: dict[tuple[str, str], float] = {("geometry_msgs/msg/Quaternion", "w"): 1.0}


class RosbagsFactory:
    """Builds any message of ROS 2 Jazzy: `factory("std_msgs/msg/Header", frame_id="camera")`."""

    def __call__(self, type_name: str, **fields: object) -> Any:
        """A message whose other fields have the type's defaults.

        Args:
            type_name: For example `sensor_msgs/msg/Image`.
            **fields: Numbers and strings, messages, sequences of those; arrays of numbers are taken without a copy
                where they are contiguous and of the field's type already.

        Raises:
            BagError: for an unknown type or field, or a value that does not fit its field.
        """
        typestore = MessageType.jazzy(type_name).typestore
        described = typestore.fielddefs[type_name][1]
        known = {name: field for name, field in described if name != _FILLER}
        for name in fields:
            if name not in known:
                raise BagError(f"{type_name} has no field {name!r}; it has {nearest(name, known)}")
        values = {
            name: _convert(f"{type_name}.{name}", field, fields[name])
            if name in fields
            else self._default(type_name, name, field)
            for name, field in known.items()
        }
        return typestore.types[type_name](**values)

    def _default(self, type_name: str, name: str, field: Any) -> Any:
        if (type_name, name) in _DEFAULTS:
            return _DEFAULTS[type_name, name]
        kind, what = field
        if kind == Nodetype.BASE:
            return _scalar_type(what[0])()
        if kind == Nodetype.NAME:
            return self(what)
        (element_kind, element), size = what
        count = size if kind == Nodetype.ARRAY else 0
        if element_kind == Nodetype.NAME:
            return [self(element) for _ in range(count)]
        return [""] * count if element[0] == "string" else np.zeros(count, _dtype(element[0]))


factory = RosbagsFactory()


def _dtype(primitive: str) -> np.dtype[Any]:
    return _DTYPES.get(primitive) or np.dtype(primitive)


def _scalar_type(primitive: str) -> type:
    if primitive in ("string", "bool"):
        return str if primitive == "string" else bool
    return float if primitive.startswith("float") else int


def _convert(where: str, field: Any, value: Any) -> Any:
    kind, what = field
    if kind == Nodetype.NAME:
        return _checked_message(where, what, value)
    if kind == Nodetype.BASE:
        return _converted_scalar(where, what[0], value)
    (element_kind, element), size = what
    if element_kind == Nodetype.NAME or element[0] == "string":
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise BagError(f"{where} takes a list, got {type(value).__name__}")
        converted: Any = [_convert(where, (element_kind, element), item) for item in value]
    else:
        converted = _converted_array(where, _dtype(element[0]), value)
    if kind == Nodetype.ARRAY and len(converted) != size:
        raise BagError(f"{where} takes {size} values, got {len(converted)}")
    if kind == Nodetype.SEQUENCE and size and len(converted) > size:
        raise BagError(f"{where} takes at most {size} values, got {len(converted)}")
    return converted


def _checked_message(where: str, type_name: str, value: Any) -> Any:
    if getattr(value, "__msgtype__", None) != type_name:
        raise BagError(f"{where} takes a {type_name}, got {getattr(value, '__msgtype__', type(value).__name__)}")
    return value


def _converted_scalar(where: str, primitive: str, value: Any) -> Any:
    wanted = _scalar_type(primitive)
    accepted: dict[type, Any] = {str: str, bool: (bool, np.bool_), int: numbers.Integral, float: numbers.Real}
    fits = isinstance(value, accepted[wanted])
    if fits and wanted is int:
        # rosbags packs a byte as signed, unlike the arrays of it
        bounds = np.iinfo(np.int8 if primitive == "byte" else _dtype(primitive))
        fits = bool(bounds.min <= value <= bounds.max)
    if not fits:
        raise BagError(f"{where} takes {primitive}, got {value!r}")
    return wanted(value)


def _converted_array(where: str, dtype: np.dtype[Any], value: Any) -> Any:
    if isinstance(value, (bytes, bytearray, memoryview)):
        value = np.frombuffer(value, np.uint8)
    array = np.asarray(value)
    fits = array.ndim == 1 and (array.dtype == dtype or array.size == 0 or np.can_cast(array.dtype, dtype, "same_kind"))
    if array.ndim == 1 and not fits and array.dtype.kind in "iu" and dtype.kind in "iu":
        bounds = np.iinfo(dtype)
        fits = bool(bounds.min <= array.min() and array.max() <= bounds.max)
    if not fits:
        raise BagError(f"{where} takes a sequence of {dtype}, got {array.dtype} of shape {array.shape}")
    return np.ascontiguousarray(array, dtype)
