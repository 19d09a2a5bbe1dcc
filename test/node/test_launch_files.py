"""The launch files against what they name: `launch` itself is not on PyPI, so they are read, not run."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from radcam_depth_ros.parameters import PARAMETERS
from radcam_depth_ros.pipeline import OUTPUT_TOPICS, PipelineConfig

ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "launch"
NAMES = {spec.name for spec in PARAMETERS}


def constant(path: Path, name: str) -> ast.expr:
    """The value of a constant in a launch file, as it is written."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return node.value
    raise AssertionError(f"{path.name} has no {name}")


def keys(path: Path, name: str) -> list[str]:
    value = constant(path, name)
    assert isinstance(value, ast.Dict)
    return [ast.literal_eval(key) for key in value.keys if key is not None]


@pytest.mark.parametrize("path", sorted(LAUNCH.glob("*.py")), ids=lambda path: path.name)
def test_python_launch_files_are_made_of_launch_alone(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert all(module and module.split(".")[0] in ("launch", "launch_ros") for module in modules)
    assert any(isinstance(node, ast.FunctionDef) and node.name == "generate_launch_description" for node in tree.body)


def test_the_arguments_are_those_of_a_vehicle() -> None:
    wanted = {"params_file", "image", "camera_info", "radar_topics", "namespace", "use_sim_time", "log_level"}
    assert wanted | {"image_transport"} <= set(keys(LAUNCH / "depth.launch.py", "ARGUMENTS"))


def test_the_parameters_that_are_set_exist() -> None:
    source = (LAUNCH / "depth.launch.py").read_text(encoding="utf-8")
    named = set(re.findall(r'^ {8}\("\w+", "(\w+)"\),$', source, re.MULTILINE))
    named |= set(re.findall(r'parameters\["(\w+)"\]', source))
    assert {"image_topic", "radar_topics", "autostart"} <= named
    assert named <= NAMES


def test_the_xml_include_passes_each_argument_on() -> None:
    arguments = keys(LAUNCH / "depth.launch.py", "ARGUMENTS")
    root = ElementTree.parse(LAUNCH / "depth.launch.xml").getroot()
    assert [argument.get("name") for argument in root.findall("arg")] == arguments
    (include,) = root.findall("include")
    assert str(include.get("file")).endswith("/launch/depth.launch.py")
    passed = {argument.get("name"): argument.get("value") for argument in include.findall("arg")}
    assert passed == {name: f"$(var {name})" for name in arguments}


def test_the_replay_passes_on_what_the_node_s_launch_file_takes() -> None:
    assert set(keys(LAUNCH / "replay.launch.py", "PASSED_ON")) <= set(keys(LAUNCH / "depth.launch.py", "ARGUMENTS"))


def test_the_executable_and_the_files_that_are_named_are_installed() -> None:
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    assert "radcam_depth_node = radcam_depth_ros.node:main" in setup
    for folder, name in (("config", "node.yaml"), ("rviz", "radcam_depth.rviz"), ("launch", "depth.launch.py")):
        assert (ROOT / folder / name).is_file()
        assert f'share_files("{folder}"' in setup


def test_rviz_shows_topics_that_exist() -> None:
    config = yaml.safe_load((ROOT / "rviz" / "radcam_depth.rviz").read_text(encoding="utf-8"))
    displays = config["Visualization Manager"]["Displays"]
    topics = {display["Topic"]["Value"] for display in displays if "Topic" in display}
    assert topics <= {f"/{topic}" for topic in (*OUTPUT_TOPICS.values(), *PipelineConfig().radars)}
