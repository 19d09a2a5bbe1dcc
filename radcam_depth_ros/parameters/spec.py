"""A parameter: which field it sets, what it means, and which values it takes."""

from __future__ import annotations

import dataclasses
import enum
import functools
import typing
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from radcam_depth_ros import estimator, pairing
from radcam_depth_ros.encoder import OutputConfig
from radcam_depth_ros.frame_builder import FrameBuilder
from radcam_depth_ros.parameters.config import NodeConfig, ParameterError

_ADJUSTABLE = frozenset(
    (
        *(f"frame_builder.{name}" for name in FrameBuilder.ADJUSTABLE),
        *(f"output.{entry.name}" for entry in dataclasses.fields(OutputConfig)),
        *(f"frame_builder.pairing.{name}" for name in pairing.ADJUSTABLE),
        *(f"estimator.{name}" for name in estimator.ADJUSTABLE),
    )
)
"""Fields of `NodeConfig` that can change while the node is active."""


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
        description: What it means, for `ros2 param describe`.
        minimum: Smallest number.
        maximum: Largest number.
        choices: All values that are allowed, for enumerated parameters.
        read_only: Only the parameter file can set it.
    """

    name: str
    path: str
    description: str
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    @property
    def default(self) -> Any:
        """The field's default."""
        return functools.reduce(getattr, self.path.split("."), NodeConfig())

    @property
    def is_adjustable(self) -> bool:
        """Whether it can be set while the node is active."""
        return self.path in _ADJUSTABLE

    @property
    def kind(self) -> ParameterKind:
        """The kind of its value, of the field's type; of a single value where a list of them is allowed as well."""
        return _KINDS[_field_type(self.path)]

    @property
    def is_for_each_radar(self) -> bool:
        """Whether it is one value for all radars or a list with one for each."""
        return _field_type(self.path) in _FOR_EACH_RADAR

    def convert(self, value: Any) -> Any:
        """The value as the field wants it: whole numbers are fine for floats.

        Raises:
            ParameterError: for a value of another type, out of range, or not among the choices.
        """
        if self.is_for_each_radar and isinstance(value, Iterable) and not isinstance(value, str):
            # An empty list says nothing.
            return tuple(self._convert_one(item) for item in value) or self.default
        return self._convert_one(value)

    def _convert_one(self, value: Any) -> Any:
        converted: Any = _CONVERSIONS[self.kind](value)
        if converted is None:
            raise ParameterError(f"the parameter {self.name} must be {self.kind.value}, got {value!r}")
        if self.choices and converted not in self.choices:
            raise ParameterError(f"the parameter {self.name} must be one of {', '.join(self.choices)}, got {value!r}")
        if self.minimum is not None and self.maximum is not None and not self.minimum <= converted <= self.maximum:
            raise ParameterError(
                f"the parameter {self.name} must be within {self.minimum:g} and {self.maximum:g}, got {value!r}"
            )
        return converted


@functools.cache
def _field_type(path: str) -> Any:
    """The type of a field of `NodeConfig`; reading annotations takes a millisecond a class."""
    *owners, name = path.split(".")
    owner: Any = NodeConfig
    for step in owners:
        owner = typing.get_type_hints(owner)[step]
    return typing.get_type_hints(owner)[name]


def _integer(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


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
