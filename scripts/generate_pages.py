"""Writes the pages and files that follow from the package's tables: `make generate`, or `--check` to compare alone.

Parameters come from `parameters.SECTIONS` and the texts beside the config's fields, outputs from `encoder.OUTPUTS`. The
policy of SROS 2 has both, and what every lifecycle node has. The version comes from package.xml.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from radcam_depth_ros.encoder import OUTPUTS, Output
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX, TRANSFORM_TOPICS, FrameBuilderConfig
from radcam_depth_ros.node.latency import LATENCY_TOPICS
from radcam_depth_ros.parameters import NODE_NAME, PARAMETERS, SECTIONS, ParameterSpec

ROOT = Path(__file__).parents[1]
BY_NAME = {spec.name: spec for spec in PARAMETERS}
BASIC = (
    "image_topic",
    "image_transport",
    "camera_info_topic",
    "radar_topics",
    "camera_from_radar",
    "camera_height_m",
    "radar_time_offset_s",
    "depth_encoding",
    "network",
    "model_file",
    "device",
)
"""What most users set."""
VERSION_LINES = {
    "radcam_depth_ros/__init__.py": r'^(__version__ = ")[^"]*(")',
    "CITATION.cff": r"^(version: )\S+()",
    "docs/references.md": r"^(  version = \{)[^}]*(\})",
}
"""The line of a file that has the version, as a pattern with what stands before and behind it."""
LINE = 120
BY = "by scripts/generate_pages.py"
BASIC_HEAD = """\
# Parameters of the node radcam_depth that most users set, with their defaults; config/node_all.yaml has all of them.
# Copy this file, keep the lines that differ on your vehicle, and start the node with it:
#   ros2 launch radcam_depth_ros depth.launch.py params_file:=my_vehicle.yaml
# replay, evaluate, train, view and check-calibration of radcam-depth take the same file by --params.
"""
ALL_HEAD = """\
# All parameters of the node radcam_depth with their defaults; config/node.yaml has those that most users set.
# All but autostart can be set while the node is not active (ros2 param set): configure and activate read them, the
# network too. Those with [live] can be set while it is active as well, and count from the next image on.
"""
SECTION = """\
# /** fits the node in any namespace and under any name.
/**:
  ros__parameters:
"""
QUALITY = """\
    # --- Quality of service
    # Inputs are best effort and volatile, outputs reliable with depth 1. Each topic has overrides, by its full name:
    #   qos_overrides./image.subscription.reliability: reliable       # best_effort, reliable
    #   qos_overrides./image.subscription.depth: 5
    #   qos_overrides./camera_info.subscription.durability: transient_local
    #   qos_overrides./depth/image_rect.publisher.reliability: best_effort
"""
PAGE_HEAD = """\
# Parameters

All parameters of the node `radcam_depth`. [config/node.yaml](../config/node.yaml) has those that most users set,
[config/node_all.yaml](../config/node_all.yaml) all of them. `replay`, `evaluate`, `train`, `view` and
`check-calibration` of `radcam-depth` take the same file by `--params`.

Live parameters can be set while the node is active and count from the next image on. All others can be set while it is
not active, except `autostart`, which counts at the start alone.
"""
POLICY_HEAD = """\
  The policy of SROS 2 for the node radcam_depth with its default parameters: exactly what it publishes, reads and
  answers, and nothing else. Names without a slash at the front are below the namespace ns. Copy the file, and put in
  your own names: topics that you remap; those of the parameters image_topic, camera_info_topic and radar_topics, of
  which image/compressed is read with image_transport: compressed alone; and that of odometry_topic, if it is set.
  docs/security.md says what to do with it.
"""
LIFECYCLE_SERVICES = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)
STANDARD_SERVICES = ("get_type_description", *LIFECYCLE_SERVICES, *PARAMETER_SERVICES)
"""Services of every lifecycle node, below its own name; the node has no others."""
STANDARD_TOPICS = ("/diagnostics", "/parameter_events", "/rosout", f"{NODE_NAME}/transition_event")
"""Topics that it publishes besides its outputs."""


def pages() -> dict[Path, str]:
    """Every generated file with the text that it should have."""
    found = {
        ROOT / "config" / "node.yaml": _parameter_file(BASIC_HEAD, {"": BASIC}),
        ROOT / "config" / "node_all.yaml": _parameter_file(
            ALL_HEAD, {title: tuple(section) for title, section in SECTIONS.items()}, QUALITY
        ),
        ROOT / "docs" / "parameters.md": _parameter_page(),
        ROOT / "config" / "sros2_policy.xml": _policy(),
    }
    for name, parts in (
        ("README.md", {f"<!-- outputs: {BY} -->": _output_table()}),
        (
            "launch/depth.launch.py",
            {
                f"# Parameters, {BY}:": _launch_help("depth", with_choices=True),
                f"# Topics that an argument replaces, {BY}:": _launch_outputs(),
            },
        ),
        ("launch/multi_camera.launch.py", {f"# Parameters, {BY}:": _launch_help("multi_camera")}),
    ):
        path = ROOT / name
        text = path.read_text(encoding="utf-8")
        for begin, part in parts.items():
            text = _replace(text, begin, part)
        found[path] = text
    version = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")
    for name, line in VERSION_LINES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        found[ROOT / name] = re.sub(line, rf"\g<1>{version}\g<2>", text, count=1, flags=re.M)
    return found


def _replace(text: str, begin: str, part: str) -> str:
    """The text with what stands between a line and its counterpart replaced."""
    indent = begin[: len(begin) - len(begin.lstrip())]
    end = f"{indent}<!-- end -->" if "<!--" in begin else "# End."
    before, rest = f"\n{text}".split(f"\n{begin}\n")
    _, after = rest.split(f"{end}\n", 1)
    return f"{before}\n{begin}\n{part}{end}\n{after}"[1:]


def _details(spec: ParameterSpec) -> str:
    """A parameter's description with its choices and range."""
    info = spec.info
    text = info.description
    if any(choice not in text for choice in info.choices):
        text += f" One of {', '.join(info.choices)}."
    if info.minimum is not None and info.maximum is not None:
        text += f" From {info.minimum:g} to {info.maximum:g}."
    return text


def _yaml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_yaml(item) for item in value)}]"
    # ROS reads `infinity` as a number.
    is_word = isinstance(value, str) and re.fullmatch(r"[a-z][\w/]*", value) and value != "infinity"
    return value if is_word else json.dumps(value)


def _parameter_file(head: str, sections: dict[str, tuple[str, ...]], tail: str = "") -> str:
    parts = []
    for title, names in sections.items():
        lines = [f"    # --- {title}"] if title else []
        for name in names:
            spec = BY_NAME[name]
            text = ("[live] " if spec.info.is_live else "") + _details(spec)
            lines += textwrap.wrap(text, LINE, initial_indent="    # ", subsequent_indent="    # ", **_WHOLE_WORDS)
            lines.append(f"    # {name}: (unset)" if spec.default is None else f"    {name}: {_yaml(spec.default)}")
        parts.append("\n".join(lines) + "\n")
    return f"# Written {BY}.\n{head}{SECTION}" + "\n".join((*parts, *((tail,) if tail else ())))


_WHOLE_WORDS: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}


def _parameter_page() -> str:
    page = f"<!-- {BY} -->\n{PAGE_HEAD}"
    for title, names in SECTIONS.items():
        page += f"\n## {title}\n| parameter | default | live | |\n| --- | --- | --- | --- |\n"
        for name in names:
            spec = BY_NAME[name]
            meaning = _details(spec).replace("<", "&lt;").replace("|", "\\|")
            default = "unset" if spec.default is None else f"`{_yaml(spec.default)}`"
            page += f"| `{name}` | {default} | {'yes' if spec.info.is_live else ''} | {meaning} |\n"
    return page


def _conditions(output: Output) -> str:
    """When an output is there, as sentences."""
    networks = " Published only by networks with a class output (`structured`)." if output.needs_classes else ""
    return networks + (" Only while subscribed." if output.is_on_demand else "")


def _output_table() -> str:
    rows = (
        f"| `{output.topic}` | {output.type_name.replace('/msg/', '/')} | {output.description}{_conditions(output)} "
        f"| {output.replayed.value} |\n"
        for output in OUTPUTS.values()
    )
    return "| out | type | | in a replayed bag |\n| --- | --- | --- | --- |\n" + "".join(rows)


def _launch_outputs() -> str:
    """The mapping of the launch file's arguments for outputs to their topics."""
    topics = {output.name: output.topic for output in OUTPUTS.values()}
    topics |= {topic: topic for topic in LATENCY_TOPICS.values()}
    rows = "".join(f'    "output/{name}": "{topic}",\n' for name, topic in topics.items())
    return f"OUTPUTS = {{\n{rows}}}\n"


def _policy() -> str:
    """The policy of SROS 2. Without ~, after which sros2 puts no slash."""
    defaults = FrameBuilderConfig()
    images = (defaults.image, f"{defaults.image}{COMPRESSED_SUFFIX}")
    read = (*images, defaults.calibration_topic, *defaults.radars, *TRANSFORM_TOPICS, "/clock")
    written = (*(output.topic for output in OUTPUTS.values()), *LATENCY_TOPICS.values(), *STANDARD_TOPICS)
    parts = (
        _allowed("topics", "publish", written),
        _allowed("topics", "subscribe", read),
        _allowed("services", "reply", tuple(f"{NODE_NAME}/{name}" for name in STANDARD_SERVICES)),
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- Written {BY}.\n{POLICY_HEAD}-->\n<policy version="0.2.0">\n'
        f'  <enclaves>\n    <enclave path="/{NODE_NAME}">\n      <profiles>\n'
        f'        <profile ns="/" node="{NODE_NAME}">\n{"".join(parts)}        </profile>\n'
        "      </profiles>\n    </enclave>\n  </enclaves>\n</policy>\n"
    )


def _allowed(kind: str, what: str, names: tuple[str, ...]) -> str:
    """A list of topics or services that the node may publish, subscribe or reply to."""
    indent, one = 10 * " ", kind.removesuffix("s")
    rows = "".join(f"{indent}  <{one}>{name}</{one}>\n" for name in sorted(set(names)))
    return f'{indent}<{kind} {what}="ALLOW">\n{rows}{indent}</{kind}>\n'


_EITHER = ("true", "false", "True", "False")


def _launch_help(file: str, *, with_choices: bool = False) -> str:
    """Mappings by parameter, of those that a launch file names: the description's first sentence, and the choices."""
    text = (ROOT / "launch" / f"{file}.launch.py").read_text(encoding="utf-8").partition("\n# Parameters, ")[0]
    specs = [spec for spec in PARAMETERS if f'"{spec.name}"' in text]
    lines = ["HELP = {", *map(_launch_help_row, specs), "}"]
    if with_choices:
        given = {spec.name: _EITHER if isinstance(spec.default, bool) else spec.info.choices for spec in specs}
        rows = {name: ("", *values) for name, values in given.items() if values}
        lines += ["CHOICES = {", *(f"    {json.dumps(name)}: {json.dumps(row)}," for name, row in rows.items()), "}"]
    return "\n".join(lines).replace("[", "(").replace("]", ")") + "\n"


def _launch_help_row(spec: ParameterSpec) -> str:
    text = spec.info.description.partition(". ")[0].removesuffix(".") + "."
    row = f"    {json.dumps(spec.name)}: {json.dumps(text)},"
    if len(row) <= LINE:
        return row
    *lines, last = textwrap.wrap(text, 80)
    parts = "\n    ".join(json.dumps(line) for line in (*(f"{line} " for line in lines), last))
    return f"    {json.dumps(spec.name)}: {parts},"


def differences() -> Iterator[Path]:
    """Generated files that are not as they should be."""
    for path, text in pages().items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            yield path.relative_to(ROOT)


def main() -> None:
    """Writes the files, or names those that differ and ends with 1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--check", action="store_true", help="write nothing, fail where a file is not as it should be")
    if parser.parse_args().check:
        old = ", ".join(map(str, differences()))
        sys.exit(f"run make generate: {old} differ" if old else 0)
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
