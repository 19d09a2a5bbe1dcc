"""Builds the node's config from parameters by name."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from radcam_depth_ros import configuration
from radcam_depth_ros.parameters.config import NodeConfig, ParameterError
from radcam_depth_ros.parameters.table import PARAMETERS

_BY_NAME = {spec.name: spec for spec in PARAMETERS}
_ALIKE = 0.7
"""From this likeness on a name is taken for another one with a typo."""


def nearest_parameter(name: str) -> str:
    """The parameter that is most like a name; empty where none is like it."""
    return next(iter(difflib.get_close_matches(name, _BY_NAME, n=1, cutoff=_ALIKE)), "")


def build_config(values: Mapping[str, Any]) -> NodeConfig:
    """All that the node is told by some parameters; those that are left out have their defaults.

    Raises:
        RadcamDepthError: for a parameter that there is not, or when a value, or values together, cannot be used.
    """
    mapping: dict[str, Any] = {}
    for parameter, value in values.items():
        if parameter not in _BY_NAME:
            near = nearest_parameter(parameter)
            hint = f"did you mean {near}?" if near else f"it has {', '.join(sorted(_BY_NAME))}"
            raise ParameterError(f"the node has no parameter {parameter}; {hint}")
        spec = _BY_NAME[parameter]
        *owners, name = spec.path.split(".")
        owner = mapping
        for step in owners:
            owner = owner.setdefault(step, {})
        owner[name] = spec.convert(value)
    return configuration.build(NodeConfig, mapping, "the parameters")
