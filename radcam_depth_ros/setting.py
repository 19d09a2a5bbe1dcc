"""Describes the fields of config dataclasses: their meaning, range and choices, and when their value may change.

The text beside a field is also that of the parameter that sets it: in `ros2 param describe`, config/node_all.yaml,
docs/parameters.md and the help of the launch files.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_KEY = "setting"


@dataclass(frozen=True)
class SettingInfo:
    """What is known of a field besides its type and default.

    Attributes:
        description: Its meaning in plain sentences, of which the first can stand alone.
        minimum: Smallest number; None where a parameter may be any.
        maximum: Largest number; None like the minimum.
        choices: All values that are allowed; empty where they are not enumerated.
        is_live: It may change between two frames.
        is_read_only: It counts at the start alone.
    """

    description: str
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    is_live: bool = False
    is_read_only: bool = False


def setting(
    default: Any,
    description: str,
    minimum: float | None = None,
    maximum: float | None = None,
    *,
    choices: tuple[str, ...] = (),
    live: bool = False,
    read_only: bool = False,
) -> Any:
    """A field of a config dataclass; the arguments are those of `SettingInfo`."""
    info = SettingInfo(description, minimum, maximum, choices, live, read_only)
    return dataclasses.field(default=default, metadata={_KEY: info})


def setting_info(config: Any, name: str) -> SettingInfo:
    """What is known of a field of a config or its class, by the field's name."""
    info: SettingInfo = next(entry for entry in dataclasses.fields(config) if entry.name == name).metadata[_KEY]
    return info


def live_settings(config: Any) -> tuple[str, ...]:
    """Names of the fields of a config or its class that may change between two frames."""
    return tuple(
        entry.name
        for entry in dataclasses.fields(config)
        if (info := entry.metadata.get(_KEY)) is not None and info.is_live
    )


def can_adjust(before: Any, after: Any) -> bool:
    """Whether two configs of a class differ in live fields only, those of nested configs included."""
    for entry in dataclasses.fields(before):
        old, new = getattr(before, entry.name), getattr(after, entry.name)
        info = entry.metadata.get(_KEY)
        if old != new and not (can_adjust(old, new) if info is None else info.is_live):
            return False
    return True


def check_choices(config: Any, error: Callable[[str], Exception]) -> None:
    """Refuses a config with a value that is not among its field's choices.

    Args:
        config: The config.
        error: Makes the exception that is raised, from its sentence.
    """
    for entry in dataclasses.fields(config):
        value, info = getattr(config, entry.name), entry.metadata.get(_KEY)
        given = value if isinstance(value, tuple) else (value,)
        if info is not None and info.choices and not {*given} <= {*info.choices}:
            raise error(f"{entry.name} must be one of {', '.join(info.choices)}, got {value!r}")
