"""Writes the node's parameters into the README: `.venv/bin/python scripts/parameter_table.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from radcam_depth_ros.parameters import PARAMETERS, ParameterSpec

README = Path(__file__).parents[1] / "README.md"
BEGIN, END = "<!-- parameters: by scripts/parameter_table.py -->\n", "<!-- end of parameters -->"


def render(text: str) -> str:
    """The README's text with the table of parameters as they are now."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    rows = "".join(
        f"| `{spec.name}` | {_default(spec.default)} | {_live(spec)} | {_meaning(spec)} |\n" for spec in PARAMETERS
    )
    return f"{before}{BEGIN}| parameter | default | live | |\n| --- | --- | --- | --- |\n{rows}{END}{after}"


def _default(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"`[{', '.join(str(item) for item in value)}]`"
    return f"`{value}`" if value != "" else '`""`'


def _live(spec: ParameterSpec) -> str:
    return "yes" if spec.is_adjustable else ""


def _meaning(spec: ParameterSpec) -> str:
    meaning = spec.description.replace("<", "&lt;")
    if spec.minimum is not None and spec.maximum is not None:
        meaning += f" {spec.minimum:g} to {spec.maximum:g}."
    return meaning


if __name__ == "__main__":
    README.write_text(render(README.read_text(encoding="utf-8")), encoding="utf-8")
