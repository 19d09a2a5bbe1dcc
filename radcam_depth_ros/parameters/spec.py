"""One parameter of the node: the field that it sets, and the conversion and check of its values."""

from __future__ import annotations

import enum
import functools
import math
import typing
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from radcam_depth_ros.parameters.config import NodeConfig, ParameterError
from radcam_depth_ros.setting import SettingInfo, setting_info


class ParameterKind(enum.Enum):
    """What a parameter's value is, by the names of ROS's own types, and in words."""

    BOOL = "true or false"
    INTEGER = "a whole number"
    DOUBLE = "a number"
    STRING = "a text"
    DOUBLE_ARRAY = "a list of numbers"
    STRING_ARRAY = "a list of texts"


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter.

    Attributes:
        name: Its name in ROS.
        path: The field of `NodeConfig` that it sets, dotted.
    """

    name: str
    path: str

    @property
    def default(self) -> Any:
        """The field's default; None where it may be left unset."""
        return _field(self.path)[0]

    @property
    def info(self) -> SettingInfo:
        """The field's description, range, choices and flags."""
        return _field(self.path)[1]

    @property
    def kind(self) -> ParameterKind:
        """The kind of its value, of the field's type; of a single value where a list of them is allowed as well."""
        return _KINDS[_field(self.path)[2]]

    @property
    def is_for_each_radar(self) -> bool:
        """Whether it is one value for all radars or a list with one for each."""
        return _field(self.path)[2] in _FOR_EACH_RADAR

    def convert(self, value: Any) -> Any:
        """The value as the field wants it: whole numbers are fine for floats.

        Raises:
            ParameterError: for a value of another type, out of range, or not among the choices.
        """
        if value is None and self.default is None:
            return None
        if self.is_for_each_radar and isinstance(value, Iterable) and not isinstance(value, str):
            # An empty list says nothing.
            return tuple(self._convert_one(item) for item in value) or self.default
        return self._convert_one(value)

    def _convert_one(self, value: Any) -> Any:
        converted: Any = _CONVERSIONS[self.kind](value)
        if converted is None:
            raise ParameterError(f"the parameter {self.name} must be {self.kind.value}, got {value!r}")
        choices, minimum, maximum = self.info.choices, self.info.minimum, self.info.maximum
        if choices and converted not in choices:
            raise ParameterError(f"the parameter {self.name} must be one of {', '.join(choices)}, got {value!r}")
        if minimum is not None and maximum is not None and not minimum <= converted <= maximum:
            raise ParameterError(f"the parameter {self.name} must be within {minimum:g} and {maximum:g}, got {value!r}")
        return converted


@functools.cache
def _field(path: str) -> tuple[Any, SettingInfo, Any]:
    """Default, description and type of a field of `NodeConfig`; reading annotations takes a millisecond a class."""
    *owners, name = path.split(".")
    owner: Any = functools.reduce(getattr, owners, NodeConfig())
    return getattr(owner, name), setting_info(owner, name), typing.get_type_hints(type(owner))[name]


def _integer(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _text(value: Any) -> str | None:
    # ROS reads the word `infinity` of a parameter file as a number.
    return "infinity" if value == math.inf else value if isinstance(value, str) else None


def _flag(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _numbers(values: Any) -> tuple[float, ...] | None:
    numbers = tuple(_number(value) for value in values) if isinstance(values, Iterable) else (None,)
    return None if None in numbers else typing.cast("tuple[float, ...]", numbers)


def _texts(values: Any) -> tuple[str, ...] | None:
    if isinstance(values, str) or not isinstance(values, Iterable):
        return None
    texts = tuple(_text(value) for value in values)
    if None in texts:
        return None
    # A parameter file cannot hold an empty list: rclpy takes it for nothing at all. [""] stands for it.
    return tuple(text for text in texts if text)


_KINDS: dict[Any, ParameterKind] = {
    bool: ParameterKind.BOOL,
    int: ParameterKind.INTEGER,
    float: ParameterKind.DOUBLE,
    str: ParameterKind.STRING,
    tuple[float, ...]: ParameterKind.DOUBLE_ARRAY,
    tuple[str, ...]: ParameterKind.STRING_ARRAY,
    float | None: ParameterKind.DOUBLE,
    float | tuple[float, ...]: ParameterKind.DOUBLE,
    str | tuple[str, ...]: ParameterKind.STRING,
}
_FOR_EACH_RADAR = (float | tuple[float, ...], str | tuple[str, ...])
_CONVERSIONS = {
    ParameterKind.BOOL: _flag,
    ParameterKind.INTEGER: _integer,
    ParameterKind.DOUBLE: _number,
    ParameterKind.STRING: _text,
    ParameterKind.DOUBLE_ARRAY: _numbers,
    ParameterKind.STRING_ARRAY: _texts,
}
