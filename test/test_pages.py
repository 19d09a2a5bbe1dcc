"""What README and docs say, against what is there: every command, option, launch argument, topic, parameter and link.

Commands are parsed, not run: `make docs` runs them, but for those of which the page says that they are not.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import typer
import yaml
from launch_mappings import launch_functions

from radcam_depth_ros.cli import app
from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.parameters import build_config
from radcam_depth_ros.training import recipe

ROOT = Path(__file__).parents[1]
DOCUMENTED: Any = runpy.run_path(str(ROOT / "scripts" / "documented_commands.py"))
TEXTS = {page: (ROOT / page).read_text(encoding="utf-8") for page in DOCUMENTED["pages"]()}
TOPICS = {*(output.topic for output in OUTPUTS.values()), FrameBuilderConfig().image, *FrameBuilderConfig().radars}
NOT_HERE = re.compile(r"^(?:sudo|ros2|docker|rosdep|git clone|colcon)\b", re.M)


def blocks(language: str) -> Iterator[tuple[str, str]]:
    for name, text in TEXTS.items():
        for block in re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S):
            yield name, block


def words_of(text: str) -> Iterator[list[str]]:
    """The words of each line."""
    for line in text.replace("\\\n", " ").splitlines():
        yield shlex.split(line, comments=True)


def commands(*beginning: str) -> list[tuple[str, list[str]]]:
    """All commands that begin with these words: page, words."""
    found = []
    for name, block in blocks("bash"):
        for words in words_of(block):
            for start in range(len(words)):
                if tuple(words[start : start + len(beginning)]) == beginning:
                    found.append((name, [word.removesuffix(";") for word in words[start + len(beginning) :]]))
                    break
    return found


@pytest.mark.parametrize("page", TEXTS)
def test_each_block_is_executed_or_says_why_it_is_not(page: str) -> None:
    text, found = TEXTS[page], DOCUMENTED["read_blocks"](page)
    assert set(re.findall(r"^```(\w+)$", text, re.M)) <= {"bash", "yaml", "xml"}
    assert len(found) == text.count("\n```bash\n")
    assert sum(bool(block.before) for block in found) == text.count("<!-- before:")
    assert sum(bool(block.edit) for block in found) == text.count("<!-- executed with:")
    reasons = [block for block in found if block.reason]
    assert len(reasons) in (text.count("\nNot executed here:"), len(found)), "a reason that belongs to no block"
    for block in found:
        if not block.reason:
            executed = DOCUMENTED["commands"](block)
            assert not NOT_HERE.search(executed), f"line {block.line} needs what is not everywhere: say so"
            assert executed != block.text or not block.edit, f"line {block.line}: the change changes nothing"


def test_examples_of_all_verbs_are_executed() -> None:
    examples = "\n".join(DOCUMENTED["examples"]())
    for command in app.registered_commands:
        assert f"radcam-depth {command.name} " in examples


def launch_arguments(file: Path) -> set[str]:
    """Names of a launch file's arguments: what it declares by name, and those of the node's file, which all include."""
    text = file.read_text(encoding="utf-8")
    node_s = launch_functions("depth.launch.py")
    names: set[str] = node_s["all_names"]()
    if file.suffix == ".xml":
        return names - {*node_s["NOT_IN_XML"]}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "DeclareLaunchArgument":
            names |= {first.value for first in node.args[:1] if isinstance(first, ast.Constant)}
    return names


@pytest.mark.parametrize(("page", "words"), commands("radcam-depth"))
def test_verbs_take_what_they_are_given(page: str, words: list[str]) -> None:
    verb, *given = words[: words.index("done")] if "done" in words else words
    command: Any = getattr(typer.main.get_command(app), "commands", {})[verb]
    context = command.make_context(verb, [], resilient_parsing=True)
    context.resilient_parsing = False  # for the context alone: what a page gives must be right
    _, rest, _ = command.make_parser(context).parse_args(given)
    assert not rest, f"{page}: {rest} is not taken"


@pytest.mark.parametrize(("page", "words"), commands("ros2", "launch", "radcam_depth_ros"))
def test_launch_files_take_what_they_are_given(page: str, words: list[str]) -> None:
    file, *given = words
    arguments = launch_arguments(ROOT / "launch" / file)
    assert {word.split(":=")[0] for word in given} <= arguments, page
    for word in given:
        name, value = word.split(":=")
        if name == "sensors":
            assert (ROOT / "config" / "sensors" / f"{value}.yaml").is_file()


@pytest.mark.parametrize(("page", "words"), commands("make"))
def test_make_targets_exist(page: str, words: list[str]) -> None:
    assert re.search(rf"^{words[0]}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M), page


@pytest.mark.parametrize("page", TEXTS)
def test_links_and_files_exist(page: str) -> None:
    for target in re.findall(r"\]\(([^):]+)\)", TEXTS[page]):
        path, _, heading = target.partition("#")
        linked = ((ROOT / page).parent / path).resolve() if path else ROOT / page
        assert linked.exists(), target
        if heading:
            lines = linked.read_text(encoding="utf-8").splitlines()
            titles = [
                re.sub(r"[^\w\- ]", "", line.lstrip("# ").lower()).replace(" ", "-")
                for line in lines
                if line[:1] == "#"
            ]
            assert heading in titles, target
    for path in re.findall(
        r"(?<![\w/])(?:config|launch|rviz|foxglove|docker)/[\w./]*\w", TEXTS[page].replace("NETWORK", "baff")
    ):
        assert (ROOT / path).exists(), path


def test_the_readme_links_every_tutorial() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"({page})" in readme for page in TEXTS if page.startswith("docs/tutorials/"))


@pytest.mark.parametrize(("page", "block"), list(blocks("yaml")))
def test_parameters_and_recipes_can_be_used(page: str, block: str) -> None:
    values = yaml.safe_load(block)
    for section in values.values():
        if isinstance(section, dict) and "ros__parameters" in section:
            assert build_config(section["ros__parameters"])
            return
    assert recipe.build(values, page)


@pytest.mark.parametrize("page", TEXTS)
def test_verbs_exist(page: str) -> None:
    verbs = {command.name for command in app.registered_commands}
    assert set(re.findall(r"radcam-depth ([a-z]+(?:-[a-z]+)*)", TEXTS[page])) <= verbs


class Parsed(Exception):  # noqa: N818  # no error: the way out of a script that would begin
    pass


SCRIPTS = [
    *(
        shlex.split(row)
        for folder in ("benchmarks", "experiments")
        for row in re.findall(rf"^\| `python -m ({folder}\.[^`]+)`", TEXTS[f"{folder}/README.md"], re.M)
    ),
    *(words for _, words in commands("-m") if words[0].startswith(("benchmarks.", "experiments."))),
]


@pytest.mark.parametrize("folder", ["benchmarks", "experiments"])
def test_each_module_of_scripts_is_named_on_their_page(folder: str) -> None:
    modules = {path.stem for path in (ROOT / folder).glob("*.py")} - {"__init__"}
    parts = {"clocks", "fuzz_messages", "memory", "soak_figures"}  # of the scripts that import them
    page = TEXTS[f"{folder}/README.md"]
    assert {name for name in modules - parts if not re.search(rf"`(?:python -m {folder}\.)?{name}\b", page)} == set()


@pytest.mark.parametrize("words", SCRIPTS, ids=" ".join)
def test_scripts_take_what_they_are_given(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    name, *given = words
    parse = argparse.ArgumentParser.parse_args

    def stop(parser: argparse.ArgumentParser, *arguments: Any) -> None:
        parse(parser, given)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    monkeypatch.setattr(sys, "argv", [name])
    is_package = (ROOT / name.replace(".", "/")).is_dir()
    script = importlib.import_module(f"{name}.__main__" if is_package else name)
    with pytest.raises(Parsed):
        script.main()


@pytest.mark.parametrize(("page", "block"), list(blocks("xml")))
def test_an_include_gives_arguments_that_there_are(page: str, block: str) -> None:
    include = next(ElementTree.fromstring(block).iter("include"))
    file = ROOT / str(include.get("file")).partition("radcam_depth_ros)/")[2]
    assert {argument.get("name") for argument in include.findall("arg")} <= launch_arguments(file), page


def test_costmaps_read_what_the_node_writes() -> None:
    sections = yaml.safe_load((ROOT / "config" / "nav2" / "costmaps.yaml").read_text(encoding="utf-8"))
    found = {}

    def collect(value: object) -> None:
        if isinstance(value, dict):
            if "topic" in value:
                found[value["topic"]] = value
            for inner in value.values():
                collect(inner)

    collect(sections)
    from_nav2_md = {"/semi_dense/points"}  # by depth_image_proc, in the namespace of what it reads
    assert set(found) == {f"/{OUTPUTS['points'].topic}"} | from_nav2_md
    assert Path(OUTPUTS["semi_dense"].topic).parent == Path(OUTPUTS["semi_dense_camera_info"].topic).parent


def test_foxglove_shows_topics_that_exist() -> None:
    layout = yaml.safe_load((ROOT / "foxglove" / "radcam_depth.json").read_text(encoding="utf-8"))
    panels = layout["configById"]

    def placed(node: object) -> list[object]:
        return [*placed(node["first"]), *placed(node["second"])] if isinstance(node, dict) else [node]

    assert sorted(map(str, placed(layout["layout"]))) == sorted(panels)
    topics = {str(panel.get("imageMode", {}).get("imageTopic", "/image")) for panel in panels.values()}
    topics |= {
        str(panel.get("imageMode", {}).get("calibrationTopic", "/depth/camera_info")) for panel in panels.values()
    }
    topics |= {topic for panel in panels.values() for topic in panel.get("topics", {})}
    known = {f"/{topic}" for topic in (*TOPICS, FrameBuilderConfig().calibration_topic)}
    assert topics <= known
    assert {"/depth/preview", "/depth/points"} <= topics
    assert any(panel.get("topicToRender") == "/diagnostics" for panel in panels.values())


def test_the_dockerfile_copies_files_that_there_are() -> None:
    lines = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    copied = [line.split()[1:-1] for line in lines if line.startswith("COPY")]
    assert copied
    assert all((ROOT / source).exists() for sources in copied for source in sources)
    assert (ROOT / "docker" / "entrypoint.sh").stat().st_mode & 0o111
