"""The rooms of the package and what each may import, as docs/design.md says."""

from __future__ import annotations

import ast
import functools
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = "radcam_depth_ros"
ROOT = Path(__file__).parents[1]
SOURCE = ROOT / PACKAGE
MODULES = sorted(SOURCE.rglob("*.py"))

FREE = {"numpy", "__future__", *sys.stdlib_module_names}
ROS = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "tf2_msgs",
}


def read_rooms() -> dict[str, tuple[set[str], set[str]]]:
    """Of each room: the rooms and the packages that it may import, from the table in docs/design.md."""
    rows = re.findall(
        r"^\| (`[\w.]+`) \|(.*)\|(.*)\|.*\|$", (ROOT / "docs/design.md").read_text(encoding="utf-8"), re.M
    )
    names = re.compile(r"`([\w.]+)`")
    return {names.findall(room)[0]: (set(names.findall(a)), set(names.findall(b))) for room, a, b in rows}


ROOMS = read_rooms()
FORBIDDEN_NAMES = {"utils", "util", "helpers", "helper", "common", "misc", "tools", "base"}
FORBIDDEN_ENDINGS = ("_new", "_old", "_v2", "_utils", "_helpers", "_common", "_misc")


def module_id(path: Path) -> str:
    return str(path.relative_to(SOURCE))


def room_of_name(name: tuple[str, ...]) -> str:
    """The room that has a row for a name within the package: a room in a room where it has its own."""
    inner = ".".join(name[:2])
    return inner if inner in ROOMS else name[0]


def room_of(path: Path) -> str:
    return room_of_name(path.relative_to(SOURCE).with_suffix("").parts)


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported_names(path: Path) -> Iterator[tuple[str, ...]]:
    """Dotted names that a module imports anywhere in it, in functions and for type checkers too, made absolute."""
    package = (PACKAGE, *path.relative_to(SOURCE).parts[:-1])
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else ()
            module = (*start, *(node.module or "").split(".")) if node.module else start
            # `from package import room` names the room in its alias.
            yield from ((*module, alias.name) for alias in node.names)


@functools.cache
def imports(path: Path) -> tuple[set[str], set[str]]:
    """Rooms of this package, and other distributions' packages beside numpy and the standard library."""
    names = list(imported_names(path))
    exported = {"__version__", "__name__"}
    own = [name[1:] for name in names if name[0] == PACKAGE and len(name) > 1 and name[1] not in exported]
    rooms = {room_of_name(name) for name in own}
    return rooms - {room_of(path)}, {name[0] for name in names} - {PACKAGE} - FREE


def test_every_room_of_the_table_exists() -> None:
    assert {room_of(path) for path in MODULES} == ROOMS.keys()


def test_a_room_in_a_room_has_its_row() -> None:
    inner = {f"{path.parts[-3]}.{path.parts[-2]}" for path in SOURCE.glob("*/*/__init__.py")}
    assert inner <= ROOMS.keys()
    assert not list(SOURCE.glob("*/*/*/__init__.py")), "rooms go two levels deep"


def test_a_room_has_at_most_fifteen_files() -> None:
    counts = Counter(str(path.parent.relative_to(SOURCE)) for path in MODULES)
    assert {room: count for room, count in counts.items() if count > 15} == {}


def test_modules_import_only_what_their_rooms_may() -> None:
    wrong = {}
    for path in MODULES:
        rooms, others = imports(path)
        allowed_rooms, allowed_others = ROOMS[room_of(path)]
        wrong[module_id(path)] = sorted((rooms - allowed_rooms) | (others - allowed_others))
    assert {module: names for module, names in wrong.items() if names} == {}, "see the table in docs/design.md"


def test_only_rooms_of_the_ros_graph_import_ros() -> None:
    importing = {room_of(path) for path in MODULES if imports(path)[1] & ROS}
    assert importing == {"bag_player", "live_topics", "node", "node.topics"}


def test_nothing_imports_node_or_cli() -> None:
    assert [module_id(path) for path in MODULES if imports(path)[0] & {"node", "cli"}] == []


def test_torchscript_is_touched_by_its_module_alone() -> None:
    touching = {
        module_id(path)
        for path in MODULES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Attribute) and node.attr in {"script", "load", "freeze"}
        if ast.unparse(node.value) == "torch.jit"
    }
    assert touching == {"networks/weights_io/torchscript.py"}


def test_modules_are_short() -> None:
    lines = {module_id(path): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert {module: count for module, count in lines.items() if count > 400} == {}, "split them along their nouns"


def test_functions_are_short() -> None:
    long = {
        f"{module_id(path)}:{node.lineno} {node.name}"
        for path in MODULES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (node.end_lineno or 0) - node.lineno + 1 > 80
    }
    assert long == set(), "a function has at most 80 lines"


def test_modules_are_named_for_a_noun() -> None:
    for path in MODULES:
        for part in path.relative_to(SOURCE).parts:
            name = part.removesuffix(".py")
            assert name.strip("_") not in FORBIDDEN_NAMES, path
            assert not name.endswith(FORBIDDEN_ENDINGS), path


def test_the_table_has_no_cycle() -> None:
    done: set[str] = set()
    while done != ROOMS.keys():
        ready = {room for room, (rooms, _) in ROOMS.items() if room not in done and rooms <= done}
        assert ready, f"these rooms import each other in a circle: {sorted(ROOMS.keys() - done)}"
        done |= ready


@pytest.mark.parametrize(
    ("missing", "rooms_that_need_it"),
    [("rclpy", ("bag_player", "live_topics", "node")), ("embreex av rerun", ("simulation",))],
)
def test_all_other_rooms_import_without(missing: str, rooms_that_need_it: tuple[str, ...]) -> None:
    script = f"""
import importlib, pkgutil, sys
sys.modules.update(dict.fromkeys("{missing}".split()))
import {PACKAGE}
for module in pkgutil.walk_packages({PACKAGE}.__path__, "{PACKAGE}.", onerror=lambda name: None):
    if module.name.split(".")[1] not in {rooms_that_need_it} and not module.name.endswith(".__main__"):
        importlib.import_module(module.name)
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
