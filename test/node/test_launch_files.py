"""The launch files against what they name; where `launch` and `launch_ros` are installed, they are run as well.

Both are not on PyPI. Where they are there, each file is launched in a process of its own with an executable in the
node's place that writes down what it was started with: names, remappings, and the parameters as rclpy reads them.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from launch_mappings import launch_mappings, mapping_keys

from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.node.latency import LATENCY_TOPICS
from radcam_depth_ros.parameters import PARAMETERS

ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "launch"
NAMES = {spec.name for spec in PARAMETERS}
OUTPUT_TOPICS = tuple(output.topic for output in OUTPUTS.values())
INPUTS = (FrameBuilderConfig().image, FrameBuilderConfig().calibration_topic, *FrameBuilderConfig().radars)
PYTHON_FILES = sorted(LAUNCH.glob("*.py"))


def depth_arguments() -> set[str]:
    mappings = launch_mappings(LAUNCH / "depth.launch.py")
    return mapping_keys(mappings["SETS"]) | mapping_keys(mappings["OTHERS"])


@pytest.mark.parametrize("path", PYTHON_FILES, ids=lambda path: path.name)
def test_python_launch_files_need_launch_alone(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    modules = {str(node.module).split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules <= {"launch", "launch_ros", *sys.stdlib_module_names}
    assert not any(isinstance(node, ast.Import) for node in ast.walk(tree))
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


@pytest.mark.parametrize("name", ["replay.launch.py", "multi_camera.launch.py"])
def test_what_is_passed_on_is_an_argument_of_the_node_s_launch_file(name: str) -> None:
    assert mapping_keys(launch_mappings(LAUNCH / name)["PASSED_ON"]) <= depth_arguments()


def test_the_xml_include_remaps_every_topic_of_the_node() -> None:
    root = ElementTree.parse(LAUNCH / "depth.launch.xml").getroot()
    defaults = {f"$(var {argument.get('name')})": argument.get("default") for argument in root.findall("arg")}
    (node,) = root.findall("node")
    remaps = {remap.get("from"): remap.get("to") for remap in node.findall("remap")}
    assert set(remaps) == {*INPUTS, *OUTPUT_TOPICS, *LATENCY_TOPICS.values()}
    assert all(defaults[str(to)] == topic for topic, to in remaps.items()), "by default each has its own name"


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
    assert topics <= {f"/{topic}" for topic in (*OUTPUT_TOPICS, *FrameBuilderConfig().radars)}
    (shown,) = [
        ast.literal_eval(node.value)
        for node in ast.parse((LAUNCH / "depth.launch.py").read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "SHOWN"
    ]
    assert topics == {f"/{topic}" for topic in shown}, "depth.launch.py moves these into a node's namespace"


# --- Run for real, where launch is installed --------------------------------------------------------------------------

RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
path, *arguments = sys.argv[1:]
given = [tuple(argument.split(":=", 1)) for argument in arguments]
service = LaunchService()
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(AnyLaunchDescriptionSource(path), launch_arguments=given)])
)
sys.exit(service.run())
"""
STAND_IN = """#!{python}
import json, os, sys, time
import rclpy
from rclpy.node import Node
arguments = sys.argv[1:]
rclpy.init(args=arguments)
node = Node("unnamed")
given = node._parameter_overrides  # rclpy can't declare the empty lists of config/node.yaml by itself
parameters = {{name: list(p.value) if hasattr(p.value, "tolist") else p.value for name, p in given.items()}}
topics = {{topic: node.resolve_topic_name(topic) for topic in {topics!r}}}
told = dict(name=node.get_name(), namespace=node.get_namespace(), parameters=parameters, topics=topics)
with open(os.path.join({folder!r}, f"node-{{os.getpid()}}.json"), "w") as file:
    json.dump(told, file)
"""
PLAYER = """#!{python}
import json, os, sys
with open({path!r}, "w") as file:
    json.dump([os.path.basename(sys.argv[0]), *sys.argv[1:]], file)
"""


def has_launch() -> bool:
    """Whether ROS's launch is installed; the checkout's folder of that name is not it."""
    try:
        return (
            importlib.util.find_spec("launch.actions") is not None
            and importlib.util.find_spec("launch_ros") is not None
        )
    except ModuleNotFoundError:
        return False


def executable(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


class Launched:
    """Launches files in an install space with stand-ins for the node and for both players.

    Args:
        folder: Temporary, its own.
    """

    def __init__(self, folder: Path) -> None:
        self.share = folder / "share" / "radcam_depth_ros"
        self._told = folder / "told"
        self._told.mkdir()
        self._folder = folder
        index = folder / "share" / "ament_index" / "resource_index" / "packages"
        index.mkdir(parents=True)
        (index / "radcam_depth_ros").touch()
        self.share.mkdir()
        for name in ("config", "launch", "rviz"):
            (self.share / name).symlink_to(ROOT / name)
        topics = (*INPUTS, *OUTPUT_TOPICS)
        text = STAND_IN.format(python=sys.executable, topics=topics, folder=str(self._told))
        executable(folder / "lib" / "radcam_depth_ros" / "radcam_depth_node", text)
        player = PLAYER.format(python=sys.executable, path=str(self._told / "played.json"))
        executable(folder / "bin" / "ros2", player)
        executable(folder / "lib" / "radcam_depth_ros" / "radcam-depth", player)

    def run(self, name: str, *arguments: str) -> list[dict[str, Any]]:
        """What the nodes were started with, by namespace and name.

        Raises:
            AssertionError: with launch's output, where it failed.
        """
        environment = os.environ | {
            "AMENT_PREFIX_PATH": os.pathsep.join((str(self._folder), os.environ.get("AMENT_PREFIX_PATH", sys.prefix))),
            "PATH": os.pathsep.join((str(self._folder / "bin"), os.environ["PATH"])),
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path and Path(path) != ROOT),
            "ROS_LOG_DIR": str(self._folder / "log"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        command = [sys.executable, "-c", RUN, str(self.share / "launch" / name), *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=self._folder)
        assert done.returncode == 0, done.stdout + done.stderr
        self.output = done.stdout + done.stderr
        told = [json.loads(path.read_text(encoding="utf-8")) for path in self._told.glob("node-*.json")]
        assert told, self.output
        return sorted(told, key=lambda node: (node["namespace"], node["name"]))

    def played(self) -> Sequence[str]:
        """The player's name and arguments."""
        arguments: list[str] = json.loads((self._told / "played.json").read_text(encoding="utf-8"))
        return arguments


@pytest.fixture
def launched(tmp_path: Path) -> Launched:
    if not has_launch():
        pytest.skip("ROS's launch and launch_ros are not installed")
    return Launched(tmp_path)


def test_launched_without_arguments(launched: Launched) -> None:
    (node,) = launched.run("depth.launch.py")
    assert (node["namespace"], node["name"]) == ("/", "radcam_depth")
    assert node["parameters"] == {"use_sim_time": False}


def test_launched_with_all_that_sets_a_parameter(launched: Launched) -> None:
    given = {
        "image": ("/front/image_raw", "image_topic", "/front/image_raw"),
        "image_transport": ("compressed", "image_transport", "compressed"),
        "camera_info": ("/front/camera_info", "camera_info_topic", "/front/camera_info"),
        "radar_topics": ("/a/points, /b/points", "radar_topics", ["/a/points", "/b/points"]),
        "image_is_rectified": ("true", "image_is_rectified", True),
        "camera_frame": ("front_optical", "camera_frame", "front_optical"),
        "radar_frame": ("42", "radar_frame", "42"),
        "camera_from_radar": ("0 0.5 0 0.5 -0.5 0.5 0.5", "camera_from_radar", [0, 0.5, 0, 0.5, -0.5, 0.5, 0.5]),
        "footprint_frame": ("base_link", "footprint_frame", "base_link"),
        "camera_height_m": ("2", "camera_height_m", 2.0),
        "radar_time_offset_s": ("-0.05", "radar_time_offset_s", -0.05),
        "depth_encoding": ("16UC1", "depth_encoding", "16UC1"),
        "output_size": ("network", "output_size", "network"),
        "points_stride": ("4", "points_stride", 4),
        "without_radar": ("hold", "without_radar", "hold"),
        "network": ("baff", "network", "baff"),
        "model_file": ("/models/mine.safetensors", "model_file", "/models/mine.safetensors"),
        "device": ("cuda:1", "device", "cuda:1"),
        "threads": ("2", "threads", 2),
        "autostart": ("false", "autostart", False),
    }
    assert set(given) == mapping_keys(launch_mappings(LAUNCH / "depth.launch.py")["SETS"])
    others = ("namespace:=car/front", "node_name:=depth", "use_sim_time:=true", "log_level:=warn")
    (node,) = launched.run("depth.launch.py", *(f"{name}:={value[0]}" for name, value in given.items()), *others)
    assert (node["namespace"], node["name"]) == ("/car/front", "depth")
    assert node["parameters"] == {"use_sim_time": True, **{name: value for _, name, value in given.values()}}


def test_launched_with_sensors_and_a_file_that_outdoes_them(launched: Launched, tmp_path: Path) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("/**: {ros__parameters: {max_wait_s: 0.5, threads: 3}}", encoding="utf-8")
    arguments = ("sensors:=ars548_nebula", f"params_file:={own}", "threads:=1")
    (node,) = launched.run("depth.launch.py", *arguments)
    parameters = node["parameters"]
    assert (parameters["radar_topics"], parameters["max_wait_s"], parameters["threads"]) == (
        ["/detection_points"],
        0.5,
        1,
    )


def test_sensors_that_there_are_not(launched: Launched) -> None:
    with pytest.raises(AssertionError, match="sensors can be ars548_nebula, astyx"):
        launched.run("depth.launch.py", "sensors:=ars999")


def test_launched_by_xml(launched: Launched) -> None:
    arguments = ("input/image:=/cam/image", "input/radar:=/radar/all", "output/depth:=/perception/depth")
    (node,) = launched.run("depth.launch.xml", *arguments, "node_name:=depth")
    assert node["name"] == "depth"
    assert node["parameters"]["radar_topics"] == ["radar/points"]
    changed = {"image": "/cam/image", "radar/points": "/radar/all", "depth/image_rect": "/perception/depth"}
    assert node["topics"] == {topic: changed.get(topic, f"/{topic}") for topic in node["topics"]}


def test_launched_for_several_cameras(launched: Launched, tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text("/**: {ros__parameters: {camera_height_m: 1.2}}", encoding="utf-8")
    arguments = (
        "cameras:=front, left",
        f"params_folder:={tmp_path}",
        "radar_topics:=/radar_front/points",
        "threads:=1",
    )
    front, left = launched.run("multi_camera.launch.py", *arguments)
    assert (front["namespace"], left["namespace"]) == ("/front", "/left")
    assert front["parameters"] == {
        "use_sim_time": False,
        "image_topic": "image_raw",
        "camera_info_topic": "camera_info",
        "radar_topics": ["/radar_front/points"],
        "threads": 1,
    }
    assert left["parameters"] == {**front["parameters"], "camera_height_m": 1.2}


@pytest.mark.parametrize(
    ("player", "start"), [(["ros2", "bag", "play"], "--start-offset"), (["radcam-depth", "play"], "--start")]
)
def test_a_replay_that_hears_of_no_active_node_plays_after_the_longest_wait(
    launched: Launched, player: list[str], start: str
) -> None:
    arguments = ("bag:=drive.mcap", "rate:=0.5", "loop:=true", "longest_wait:=2", "sensors:=astyx")
    (node,) = launched.run("replay.launch.py", *arguments, f"player:={player[0]}")
    assert node["parameters"]["use_sim_time"] is True
    assert node["parameters"]["image_transport"] == "compressed"
    assert launched.played() == [*player, "drive.mcap", "--clock", "--rate", "0.5", start, "0.0", "--loop"]


def test_without_rosbag2_a_replay_has_a_player_of_its_own(launched: Launched) -> None:
    launched.run("replay.launch.py", "bag:=drive.mcap", "longest_wait:=0.5")
    assert launched.played()[0] == ("ros2" if importlib.util.find_spec("ros2bag") else "radcam-depth")
