"""Builds rclpy messages for the encoders."""

from __future__ import annotations

import array
import importlib
from functools import cache
from typing import Any

import numpy as np

_INTEGERS = frozenset(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
_SEQUENCES = {"sequence<uint8>": "B", "sequence<float>": "f", "sequence<double>": "d"}


@cache
def message_class(type_name: str) -> Any:
    """The class of a type such as `sensor_msgs/msg/Image`; imports its package on first use.

    Raises:
        ModuleNotFoundError: when the package is not installed.
    """
    package, _, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


@cache
def _field_types(type_name: str) -> dict[str, str]:
    types: dict[str, str] = message_class(type_name).get_fields_and_field_types()
    return types


def build_message(type_name: str, **fields: object) -> Any:
    """Builds an rclpy message: the node's `MessageFactory`.

    rclpy serialises an int in a float field, and numpy's scalars anywhere, as garbage unless ROS_PYTHON_CHECK_FIELDS is
    set, and takes hundreds of milliseconds for a numpy array where an array.array takes 0.2 ms. Both are settled here.

    Args:
        type_name: As in `sensor_msgs/msg/Image`.
        **fields: Values by field name; those left out keep the type's default.
    """
    # With checks a field takes an array.array as it is; without, it copies it.
    message = message_class(type_name)(check_fields=True)
    types = _field_types(type_name)
    for name, value in fields.items():
        setattr(message, name, _as_field(value, types[name]))
    return message


def _as_field(value: Any, field_type: str) -> object:
    if isinstance(value, np.ndarray):
        return _as_sequence(value, field_type)
    if field_type in ("float", "double"):
        return float(value)
    if field_type in _INTEGERS:
        return int(value)
    if field_type == "boolean":
        return bool(value)
    return value


def _as_sequence(values: np.ndarray[Any, Any], field_type: str) -> object:
    code = _SEQUENCES.get(field_type)
    if code is None:
        return values  # fixed arrays such as K are numpy arrays in rclpy, too
    owner: Any = values
    while isinstance(owner, np.ndarray):
        owner = owner.base
    owner = owner.obj if isinstance(owner, memoryview) else owner
    # Depth is written into such memory from the start, see `resampling`.
    if isinstance(owner, array.array) and (owner.typecode, len(owner) * owner.itemsize) == (code, values.nbytes):
        return owner
    sequence = array.array(code)
    sequence.frombytes(np.ascontiguousarray(values, code).reshape(-1).view(np.uint8).data)
    return sequence
