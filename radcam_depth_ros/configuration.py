"""Builds frozen dataclasses from YAML; refuses unknown keys and wrong values with one sentence."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from radcam_depth_ros.frame import RadcamDepthError

ConfigT = TypeVar("ConfigT")


class ConfigurationError(RadcamDepthError):
    """A configuration with an unknown key, a wrong value, or a file that cannot be read."""


def build(cls: type[ConfigT], mapping: Mapping[str, Any], source: str = "the configuration") -> ConfigT:
    """Builds a frozen dataclass, whose fields may be dataclasses too, from nested mappings.

    Args:
        cls: The dataclass.
        mapping: Its values; missing keys take the field's default.
        source: What to call the mapping in errors, a file's name for example.

    Raises:
        ConfigurationError: for an unknown key, naming the nearest known one, or a value of the wrong type or range.
    """
    _refuse_unknown_keys(cls, mapping, source, "")
    try:
        return TypeAdapter(cls).validate_python(dict(mapping))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "its values"
        raise ConfigurationError(f"{source}: {where}: {first['msg']}, got {_shown(first.get('input'))}") from None


def _shown(value: object) -> str:
    """A value as Python writes it; Python refuses to write an integer of thousands of digits."""
    try:
        return repr(value)
    except ValueError:
        return "an integer of too many digits"


def load(cls: type[ConfigT], path: Path | str) -> ConfigT:
    """Builds a dataclass from a YAML file.

    Raises:
        ConfigurationError: when the file cannot be read, is not a YAML mapping, or does not fit `cls`.
    """
    return build(cls, read(path), str(path))


def read(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML file; ConfigurationError when it cannot be read, or is none."""
    try:
        mapping = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except Exception as error:  # values that are not what their form says make the parser raise nearly anything
        reason = " ".join(str(error).split())
        raise ConfigurationError(f"cannot read {path} as YAML: {reason}") from None
    if not isinstance(mapping, dict):
        raise ConfigurationError(f"{path} must hold a YAML mapping of settings, got {type(mapping).__name__}")
    return mapping


def overlaid(base: ConfigT, mapping: Mapping[str, Any], source: str = "the configuration") -> ConfigT:
    """A dataclass with some of its values replaced, and of those that are dataclasses some of theirs.

    Args:
        base: The dataclass, which is left as it is.
        mapping: The other values.
        source: What to call the mapping in errors.

    Raises:
        ConfigurationError: as `build`.
    """
    return build(type(base), _overlaid(base, mapping), source)


def _overlaid(base: Any, mapping: Mapping[str, Any]) -> dict[str, Any]:
    values = {entry.name: getattr(base, entry.name) for entry in dataclasses.fields(base)}
    for key, value in mapping.items():
        inner = values.get(key)
        is_nested = dataclasses.is_dataclass(inner) and isinstance(value, Mapping)
        values[key] = _overlaid(inner, value) if is_nested else value
    return values


def as_mapping(config: Any) -> dict[str, Any]:
    """The plain values of a dataclass, for YAML or JSON: tuples become lists."""
    plain: dict[str, Any] = TypeAdapter(type(config)).dump_python(config, mode="json")
    return plain


def _refuse_unknown_keys(cls: Any, mapping: Mapping[Any, Any], source: str, prefix: str) -> None:
    hints = typing.get_type_hints(cls)
    known = [entry.name for entry in dataclasses.fields(cls)]
    for key, value in mapping.items():
        if key not in known:
            name = key if isinstance(key, str) else _shown(key)
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"known keys are {', '.join(known)}"
            raise ConfigurationError(f"{source}: unknown key {prefix}{name}; {hint}")
        if dataclasses.is_dataclass(hints[key]) and isinstance(value, Mapping):
            _refuse_unknown_keys(hints[key], value, source, f"{prefix}{key}.")
        entry = next((part for part in typing.get_args(hints[key]) if dataclasses.is_dataclass(part)), None)
        if entry is not None and isinstance(value, (list, tuple)):
            for index, item in enumerate(value):
                if isinstance(item, Mapping):
                    _refuse_unknown_keys(entry, item, source, f"{prefix}{key}[{index}].")
