"""Writes the suggested parameters as a ROS parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from radcam_depth_ros.files import write_text
from radcam_depth_ros.inspection.suggestion import Setting, Suggestion


def write_parameters(path: Path | str, suggestion: Suggestion, source: str) -> None:
    """Writes a ROS 2 parameter file, whole or not at all.

    Args:
        path: The file.
        suggestion: The parameters.
        source: The bag that they fit, for the file's first line.

    Raises:
        RadcamDepthError: for parameters that the node would refuse, or a file that cannot be written.
    """
    check_parameters(suggestion.parameters)
    write_text(path, render_parameters(suggestion, source))


def render_parameters(suggestion: Suggestion, source: str) -> str:
    """The parameters as YAML, with a comment for each."""
    lines = [f"# Parameters of the node radcam_depth for {source}; all others are in config/node_all.yaml."]
    lines += ["/**:", "  ros__parameters:"]
    for setting in suggestion.settings:
        lines += [f"    # {setting.reason}", f"    {'' if setting.is_needed else '# '}{_entry(setting)}"]
    return "\n".join(lines) + "\n"


def check_parameters(parameters: Mapping[str, object]) -> None:
    """Refuses what the node would refuse.

    Raises:
        RadcamDepthError: for a value that cannot be used, or values that do not fit together.
    """
    from radcam_depth_ros.parameters import build_config  # here, since it brings torch

    build_config(parameters)


def _entry(setting: Setting) -> str:
    # A list on one line, as ROS's own parameter files have it; safe_dump would put braces around a single value.
    style = None if isinstance(setting.value, list) else False
    text: str = yaml.safe_dump({setting.name: setting.value}, default_flow_style=style, width=10_000)
    return text.strip()
