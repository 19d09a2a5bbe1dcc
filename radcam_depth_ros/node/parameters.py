"""Declares the node's parameters, checks new values, and reads them as one config.

What a parameter file gives is checked here rather than by rclpy, which would end the node at an unknown value or at an
integer for a float: a node that stays up can say what is wrong in its diagnostics.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterUninitializedException
from rclpy.node import Node
from rclpy.parameter import Parameter

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.parameters import (
    PARAMETERS,
    RENAMED,
    NodeConfig,
    ParameterError,
    ParameterKind,
    ParameterSpec,
    build_config,
)
from radcam_depth_ros.printable import printable

_BY_NAME = {spec.name: spec for spec in PARAMETERS}
TYPES = {kind: Parameter.Type[kind.name] for kind in ParameterKind}
"""The ROS type of each kind."""


def describe(spec: ParameterSpec) -> ParameterDescriptor:
    """A parameter's description, range and choices for ROS tools."""
    info, minimum, maximum = spec.info, spec.info.minimum, spec.info.maximum
    descriptor = ParameterDescriptor(
        description=info.description, read_only=info.is_read_only, dynamic_typing=spec.is_for_each_radar
    )
    if info.choices:
        descriptor.additional_constraints = f"one of {', '.join(info.choices)}"
    if minimum is None or maximum is None:
        return descriptor
    if spec.kind is ParameterKind.INTEGER:
        descriptor.integer_range = [IntegerRange(from_value=int(minimum), to_value=int(maximum))]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(minimum), to_value=float(maximum))]
    return descriptor


class Parameters:
    """Declares the node's parameters and reads them as one `NodeConfig`.

    Args:
        node: Whose parameters these are.
        on_set: Called with the names of parameters that were set.
        warn: Called with a sentence for each parameter that is given under an old name.
    """

    def __init__(
        self,
        node: Node,
        on_set: Callable[[tuple[str, ...]], None] = lambda names: None,
        warn: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._node = node
        self._warn = warn
        self._on_set = on_set
        self._refused: dict[str, str] = {}
        """What the parameter file gave that cannot be used, until it is set to something else."""
        self.frozen_because = ""
        """Why parameters that are not live can't be changed now; empty when they can."""
        for spec in PARAMETERS:
            self._declare(spec)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._note)

    def read(self) -> NodeConfig:
        """All parameters as they are now.

        Raises:
            RadcamDepthError: when a value, or values together, cannot be used.
        """
        if self._refused:
            raise ParameterError(next(iter(self._refused.values())))
        return self._build({})

    def _declare(self, spec: ParameterSpec) -> None:
        given, value = self._given(spec.name), spec.default
        for old in (old for old, new in RENAMED.items() if new == spec.name):
            by_old_name = self._given(old)
            if by_old_name is not None:
                self._warn(f"the parameter {old} is now called {spec.name}; rename it in the parameter file")
                given = by_old_name if given is None else given
        if given is not None:
            try:
                value = spec.convert(given)
            except ParameterError as error:
                self._refused[spec.name] = str(error)
        if value is None or (value == () and spec.kind is ParameterKind.DOUBLE_ARRAY):
            # Declared by its type, it has no value; rclpy takes an empty list for one of bytes.
            self._node.declare_parameter(spec.name, TYPES[spec.kind], describe(spec), ignore_override=True)
            return
        if isinstance(value, tuple):
            value = list(value) or [""]
        self._node.declare_parameter(spec.name, value, describe(spec), ignore_override=True)

    def _given(self, name: str) -> Any:
        """What the parameter file gives, whatever its type: declared without one, to be declared again."""
        given = self._node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True)).value
        self._node.undeclare_parameter(name)
        return given

    def _build(self, changes: dict[str, Any]) -> NodeConfig:
        """The config with some parameters changed."""
        return build_config(
            {spec.name: changes[spec.name] if spec.name in changes else self._value(spec) for spec in PARAMETERS}
        )

    def _value(self, spec: ParameterSpec) -> Any:
        try:
            return spec.convert(self._node.get_parameter(spec.name).value)
        except ParameterUninitializedException:
            return spec.default

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        """Whether parameters may be set to new values, all together."""
        changes = {parameter.name: parameter.value for parameter in parameters if parameter.name in _BY_NAME}
        try:
            frozen = [name for name, value in changes.items() if self._is_frozen(_BY_NAME[name], value)]
            if frozen:
                reason = f"{' and '.join(frozen)} cannot change now: {self.frozen_because}"
                return SetParametersResult(successful=False, reason=reason)
            if not self._refused.keys() - changes.keys():
                self._build(changes)
            else:
                for name, value in changes.items():
                    _BY_NAME[name].convert(value)
        except RadcamDepthError as error:
            return SetParametersResult(successful=False, reason=printable(str(error)))
        return SetParametersResult(successful=True)

    def _is_frozen(self, spec: ParameterSpec, value: Any) -> bool:
        # What stays as it is may be set, so that a whole file can be loaded.
        return bool(self.frozen_because) and not spec.info.is_live and spec.convert(value) != self._value(spec)

    def _note(self, parameters: list[Parameter]) -> None:
        names = tuple(parameter.name for parameter in parameters if parameter.name in _BY_NAME)
        for name in names:
            self._refused.pop(name, None)
        if names:
            self._on_set(names)
