"""Reads the node's parameter file without ROS, as ROS reads it.

A file has a section for each node, by its name, its full name, or a wildcard (`/**`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from radcam_depth_ros.parameters.assembly import nearest_parameter
from radcam_depth_ros.parameters.config import ParameterError
from radcam_depth_ros.parameters.table import PARAMETERS, RENAMED

NODE_NAME = "radcam_depth"
_SECTION = "ros__parameters"
_WILDCARDS = ("*", "**")
_KNOWN = frozenset(spec.name for spec in PARAMETERS)
_OF_ANY_NODE = ("use_sim_time", "start_type_description_service")
_QOS = "qos_overrides."
_NODE_ONLY = ("autostart", *_OF_ANY_NODE)


@dataclass(frozen=True)
class ParameterFile:
    """What a parameter file gives the node.

    Attributes:
        path: The file.
        namespace: The node's, as the file names it: `/front`, or empty for none and for any.
        values: The node's parameters, by name.
        node_only: Names of those that mean something to a running node alone; they are not in `values`.
        renamed: Old names in the file, each with the parameter that it stands for.
    """

    path: Path
    namespace: str
    values: Mapping[str, Any]
    node_only: tuple[str, ...] = ()
    renamed: tuple[tuple[str, str], ...] = ()


def read_parameter_file(path: Path | str) -> ParameterFile:
    """Reads the sections of a ROS 2 parameter file that are for the node; a later one wins.

    Values are not checked: `build_config` does that.

    Raises:
        ParameterError: for a file that cannot be read, is of another node or package, or has an unknown parameter.
    """
    path = Path(path)
    sections = dict(_sections(_load(path)))
    if not sections:
        raise ParameterError(
            f"{path} is no ROS 2 parameter file: expected {NODE_NAME} or /** with {_SECTION} below it, got no "
            f"{_SECTION}; `radcam-depth inspect --write-params` writes one"
        )
    own = {name: values for name, values in sections.items() if name.rpartition("/")[2] in (NODE_NAME, *_WILDCARDS)}
    if not own:
        raise ParameterError(
            f"{path} is for {', '.join(sections)}, expected parameters of {NODE_NAME} or /**; rename the section, or "
            "give the node's own file"
        )
    given: dict[str, Any] = {}
    for values in own.values():
        given.update(_flat(values, path))
    renamed = tuple((old, new) for old, new in RENAMED.items() if old in given)
    for old, new in renamed:
        given.setdefault(new, given.pop(old))
    _refuse_unknown(given, path)
    node_only = tuple(name for name in given if name in _NODE_ONLY or name.startswith(_QOS))
    values = {name: value for name, value in given.items() if name not in node_only}
    return ParameterFile(path, _namespace(own, path), values, node_only, renamed)


class _Loader(yaml.SafeLoader):
    """YAML with the floats of ROS's own reader: 1e-3 is a number."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def _load(path: Path) -> Mapping[str, Any]:
    try:
        # A safe loader all the same, with one more form of numbers.
        text = path.read_text(encoding="utf-8")
        mapping = yaml.load(text, _Loader)  # nosec B506  # _Loader is a SafeLoader
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise ParameterError(f"cannot read {path} as a parameter file: {reason}") from None
    if not isinstance(mapping, dict):
        raise ParameterError(
            f"{path} is no parameter file: expected a mapping with {NODE_NAME} or /**, got {type(mapping).__name__}"
        )
    return mapping


def _sections(mapping: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """Full names of nodes with their parameters; a namespace may be a level of its own."""
    for key, value in mapping.items():
        name = f"{place}/{str(key).strip('/')}"
        if isinstance(value, dict):
            if _SECTION in value:
                yield name, value[_SECTION]
            yield from _sections({inner: entry for inner, entry in value.items() if inner != _SECTION}, name)


def _flat(values: Any, path: Path, prefix: str = "") -> dict[str, Any]:
    """Parameters by their names, of which parts may be levels of their own."""
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ParameterError(f"{path}: {_SECTION} must be a mapping of parameters, got {type(values).__name__}")
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        found.update(_flat(value, path, f"{name}.") if isinstance(value, dict) else {name: value})
    return found


def _refuse_unknown(given: Mapping[str, Any], path: Path) -> None:
    unknown = [name for name in given if name not in (*_KNOWN, *_OF_ANY_NODE) and not name.startswith(_QOS)]
    if not unknown:
        return
    near = {name: nearest_parameter(name) for name in unknown}
    if not given.keys() & _KNOWN and not any(near.values()):
        raise ParameterError(
            f"{path} has no parameter of {NODE_NAME} but {', '.join(unknown[:5])}{' ...' if unknown[5:] else ''}, "
            "which are of another package; give the node's own file"
        )
    name = next((name for name in unknown if near[name]), unknown[0])
    what = f"did you mean {near[name]}?" if near[name] else "config/node_all.yaml lists all of them"
    raise ParameterError(f"{path}: the node has no parameter {name}; {what}")


def _namespace(sections: Mapping[str, Any], path: Path) -> str:
    """The namespace that sections name, of which there may be one."""
    places = {name: name.rpartition("/")[::2] for name in sections}
    spaces = {place for place, last in places.values() if "*" not in place and (place or last == NODE_NAME)}
    if len(spaces) > 1:
        raise ParameterError(
            f"{path} is for several nodes, {', '.join(sections)}; expected one, so leave one of them in the file"
        )
    return spaces.pop() if spaces else ""
