"""The launch files against what they name, and the rules of their arguments; test_launched.py runs them for real."""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from launch_mappings import INPUTS, OUTPUT_TOPICS, launch_functions, launch_mappings, mapping_keys

from radcam_depth_ros.node.latency import LATENCY_TOPICS
from radcam_depth_ros.parameters import PARAMETERS, ParameterKind

ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "launch"
NAMES = {spec.name for spec in PARAMETERS}
PYTHON_FILES = sorted(LAUNCH.glob("*.py"))


def depth_arguments() -> set[str]:
    mappings = launch_mappings(LAUNCH / "depth.launch.py")
    return {name for mapping in ("SETS", "OTHERS", "OTHER_NAMES") for name in mapping_keys(mappings[mapping])}


@pytest.mark.parametrize("path", PYTHON_FILES, ids=lambda path: path.name)
def test_python_launch_files_need_launch_alone(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    modules |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    assert modules <= {"launch", "launch_ros", *sys.stdlib_module_names}
    assert any(isinstance(node, ast.FunctionDef) and node.name == "generate_launch_description" for node in tree.body)


def test_the_arguments_are_those_of_a_vehicle() -> None:
    wanted = {
        "params_file",
        "sensors",
        "image",
        "camera_info",
        "radar_topics",
        "namespace",
        "use_sim_time",
        "log_level",
    }
    assert wanted | {"image_transport", "respawn", "rviz"} <= depth_arguments()


def test_the_parameters_that_are_set_exist() -> None:
    entries = launch_mappings(LAUNCH / "depth.launch.py")["SETS"].values
    named = {ast.literal_eval(entry.elts[0]) for entry in entries if isinstance(entry, ast.Tuple)}
    assert {"image_topic", "radar_topics", "autostart"} <= named <= NAMES


def test_what_several_cameras_get_alike_are_arguments_of_the_node_s_launch_file() -> None:
    assert mapping_keys(launch_mappings(LAUNCH / "multi_camera.launch.py")["PASSED_ON"]) <= depth_arguments()


def test_an_argument_replaces_each_output_s_topic() -> None:
    outputs = launch_functions("depth.launch.py")["OUTPUTS"]
    assert set(outputs.values()) == {*OUTPUT_TOPICS, *LATENCY_TOPICS.values()}
    assert all(name.startswith("output/") for name in outputs)


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
    assert topics <= {f"/{topic}" for topic in (*INPUTS, *OUTPUT_TOPICS)}
    shown = launch_functions("depth.launch.py")["SHOWN"]
    assert topics == {f"/{topic}" for topic in shown}, "depth.launch.py moves these into a node's namespace"


# --- The rules of the arguments, without launch -----------------------------------------------------------------------


@pytest.fixture
def depth() -> dict[str, Any]:
    """What depth.launch.py defines."""
    return launch_functions("depth.launch.py")


def given(depth: dict[str, Any], **arguments: str) -> dict[str, str]:
    """The values of all arguments where some are given."""
    defaults = {name: default for name, (default, _) in depth["OTHERS"].items()}
    empty = dict.fromkeys((*depth["SETS"], *depth["OTHER_NAMES"]), "")
    values: dict[str, str] = depth["with_other_names"]({**empty, **defaults, **depth["OUTPUTS"], **arguments})
    return values


def test_what_is_not_given_is_left_to_others(depth: dict[str, Any]) -> None:
    assert depth["parameters_of"](given(depth)) == {}, "use_sim_time as well, which SetParameter may have set"
    assert depth["remappings"](given(depth)) == []
    assert depth["rviz_remappings"](given(depth)) == []


@pytest.mark.parametrize(("text", "value"), [("True", True), ("true", True), ("False", False), ("false", False)])
def test_true_and_false_in_both_spellings(depth: dict[str, Any], text: str, value: bool) -> None:
    flags = {spec.name for spec in PARAMETERS if spec.kind is ParameterKind.BOOL} & depth["SETS"].keys()
    choices = {name: depth["CHOICES"][name] for name in flags} | depth["OTHER_CHOICES"]
    assert all(text in choices[name] for name in (*flags, "use_sim_time", "respawn", "rviz"))
    for name in (*flags, "use_sim_time"):
        assert depth["parameters_of"](given(depth, **{name: text})) == {name: value}


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("radar_frame", "ra", "ra"),
        ("radar_frame", "42", "42"),
        ("radar_frame", "ra, rb", ["ra", "rb"]),
        ("radar_frame", ",rb", ["", "rb"]),
        ("radar_time_offset_s", "0.0,-0.05", [0.0, -0.05]),
        ("radar_time_offset_s", "-0.05", -0.05),
        ("radar_topics", "/a/points,/b/points", ["/a/points", "/b/points"]),
        ("radar_topics", "['/a/points', '/b/points']", ["/a/points", "/b/points"]),
        ("radar_topics", ",", [""]),
        ("camera_from_radar", "[0, 0.5, 0, 0.5, -0.5, 0.5, 0.5]", [0.0, 0.5, 0.0, 0.5, -0.5, 0.5, 0.5]),
        ("camera_from_radar", "0 0.5 0 0.5 -0.5 0.5 0.5", [0.0, 0.5, 0.0, 0.5, -0.5, 0.5, 0.5]),
        ("threads", "2", 2),
        ("camera_height_m", "1", 1.0),
    ],
)
def test_arguments_are_read_as_their_parameters_want_them(
    depth: dict[str, Any], name: str, text: str, value: object
) -> None:
    parameters = depth["parameters_of"](given(depth, **{name: text}))
    assert parameters == {name: value}
    (spec,) = (spec for spec in PARAMETERS if spec.name == name)
    spec.convert(value)


def test_every_parameter_of_each_radar_can_be_a_list(depth: dict[str, Any]) -> None:
    specs = {spec.name: spec for spec in PARAMETERS}
    names = [parameter for parameter, _ in depth["SETS"].values() if specs[parameter].is_for_each_radar]
    assert {"radar_frame", "radar_time_offset_s"} <= {*names}
    assert all(isinstance(depth["read"](name, "1,2"), list) for name in names)


@pytest.mark.parametrize("text", ["four", "1,x", "[]", "1.5 m"])
def test_a_value_of_another_kind_ends_with_the_argument_s_name(depth: dict[str, Any], text: str) -> None:
    for name, (_, convert) in depth["SETS"].items():
        if convert in depth["EXPECTED"]:
            if convert is depth["numbers"] and text == "[]":
                continue  # an empty list is one of numbers
            with pytest.raises(RuntimeError, match=rf"^the argument {name} must be .*number.*, got '"):
                depth["read"](name, text)


def test_an_input_has_its_parameter_s_name_and_autoware_s_as_well(depth: dict[str, Any]) -> None:
    assert depth["parameters_of"](given(depth, image_topic="/a")) == {"image_topic": "/a"}
    assert depth["parameters_of"](given(depth, **{"input/radar": "/a,/b"})) == {"radar_topics": ["/a", "/b"]}
    assert given(depth, param_file="a.yaml")["params_file"] == "a.yaml"
    assert given(depth, image="/a", image_topic="/b")["image"] == "/a"
    named = {parameter for argument, (parameter, _) in depth["SETS"].items() if argument != parameter}
    assert named <= depth["OTHER_NAMES"].keys(), "every parameter's own name is an argument"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["image:=/a", "--noninteractive", "launch-prefix:=gdb"], ""),
        (["imgae:=/a"], "imgae (did you mean image?)"),
        (["radar_topic:=/a", "wheels:=4"], "radar_topic (did you mean radar_topics?), wheels"),
    ],
)
def test_names_that_nothing_takes_are_told(depth: dict[str, Any], words: list[str], expected: str) -> None:
    assert depth["unknown_names"](words, {*depth["all_names"](), *depth["OF_LAUNCH"]}) == expected


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["ros2", "launch", "radcam_depth_ros", "replay.launch.py", "bag:=a"], "replay.launch.py"),
        (["ros2", "launch", str(LAUNCH / "depth.launch.xml")], "depth.launch.xml"),
        (["ros2", "launch", "my_stack", "depth.launch.py", "vehicle:=one"], None),
        (["my_launcher"], None),
    ],
)
def test_only_a_file_that_is_launched_itself_owns_the_command_line(
    depth: dict[str, Any], words: list[str], file: str | None
) -> None:
    assert depth["launched_file"](words) == (LAUNCH / file if file else None)


def test_rviz_follows_the_node(depth: dict[str, Any]) -> None:
    moved = dict(depth["rviz_remappings"](given(depth, namespace="/car/front", **{"output/preview": "/shown"})))
    assert moved.pop("/depth/preview") == "/shown"
    assert moved == {f"/{topic}": f"/car/front/{topic}" for topic in depth["SHOWN"] if topic != "depth/preview"}


def test_without_rviz_nothing_is_started(depth: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "my_stack", "bringup.launch.py"])
    globals_ = depth["start"].__globals__
    values = given(depth, rviz="True")
    globals_["LaunchConfiguration"] = lambda name: SimpleNamespace(perform=lambda _: values[name])
    globals_["FindPackageShare"] = lambda _: SimpleNamespace(perform=lambda _: str(ROOT))
    context = SimpleNamespace(launch_configurations=values, argv=[])
    assert [globals_["LifecycleNode"](), globals_["Node"]()] == depth["start"](context)

    def missing(**_: str) -> None:
        raise LookupError("package 'rviz2' not found")

    globals_["ExecutableInPackage"] = missing
    with pytest.raises(RuntimeError, match="rviz:=true needs the package rviz2, which is not installed"):
        depth["start"](context)


def test_the_xml_file_hands_all_to_the_python_file() -> None:
    text = (LAUNCH / "depth.launch.xml").read_text(encoding="utf-8")
    fixed = {line.split('"')[1] for line in text.splitlines() if "<arg " in line}
    assert fixed == {*launch_functions("depth.launch.py")["NOT_IN_XML"]}
    assert "/launch/depth.launch.py" in text
