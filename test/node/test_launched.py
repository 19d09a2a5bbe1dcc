"""The launch files as `launch` runs them, where it is installed: see `launched`."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from launch_mappings import INPUTS, OUTPUT_TOPICS, launch_mappings, mapping_keys
from launched import Launched, has_launch

ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "launch"
FILES = ("depth.launch.py", "depth.launch.xml")
INCLUDE = '<include file="$(find-pkg-share radcam_depth_ros)/launch/{}">{}</include>'


@pytest.fixture
def launched(tmp_path: Path) -> Launched:
    if not has_launch():
        pytest.skip("ROS's launch and launch_ros are not installed")
    return Launched(tmp_path, (*INPUTS, *OUTPUT_TOPICS))


def test_launched_without_arguments(launched: Launched) -> None:
    (node,) = launched.run("depth.launch.py")
    assert (node["namespace"], node["name"]) == ("/", "radcam_depth")
    assert node["parameters"] == {}


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
    assert "sensors can be ars548_nebula, astyx" in launched.refused("depth.launch.py", "sensors:=ars999")


def test_launched_by_xml(launched: Launched) -> None:
    arguments = ("input/image:=/cam/image", "input/radar:=/radar/a, /radar/b", "output/depth:=/perception/depth")
    (node,) = launched.run("depth.launch.xml", *arguments, "node_name:=depth", "threads:=2")
    assert node["name"] == "depth"
    given = {"image_topic": "/cam/image", "radar_topics": ["/radar/a", "/radar/b"], "threads": 2}
    assert node["parameters"] == given
    changed = {"depth/image_rect": "/perception/depth"}
    assert node["topics"] == {topic: changed.get(topic, f"/{topic}") for topic in node["topics"]}


@pytest.mark.parametrize("file", FILES)
def test_both_files_take_the_parameter_s_name_and_a_parameter_file(
    launched: Launched, tmp_path: Path, file: str
) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("/**: {ros__parameters: {max_wait_s: 0.5}}", encoding="utf-8")
    names = {"image_topic": "/a/image", "camera_info_topic": "/a/camera_info", "radar_topics": "[/a/points, /b/points]"}
    (node,) = launched.run(file, f"params_file:={own}", *(f"{name}:={value}" for name, value in names.items()))
    assert node["parameters"] == {**names, "radar_topics": ["/a/points", "/b/points"], "max_wait_s": 0.5}


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("imgae:=/front/image", "{} takes no argument imgae (did you mean image?)"),
        ("points_stride:=four", "the argument points_stride must be a whole number, got 'four'"),
        ("use_sim_time:=yes", 'Argument "use_sim_time" provided value "yes" is not valid'),
    ],
    ids=lambda value: value.split(":=")[0],
)
def test_a_word_that_is_mistyped_ends_with_its_name(launched: Launched, file: str, word: str, expected: str) -> None:
    assert expected.format(file) in launched.refused(file, word)


@pytest.mark.parametrize(
    ("file", "words"),
    [("multi_camera.launch.py", ("cameras:=front,left",)), ("replay.launch.py", ("bag:=drive.mcap",))],
)
def test_files_that_include_the_node_s_end_with_the_name_as_well(
    launched: Launched, file: str, words: tuple[str, ...]
) -> None:
    line = launched.refused(file, *words, "radar_topic:=/radar/points")
    assert f"{file} takes no argument radar_topic (did you mean radar_topics?)" in line


def test_xml_has_neither_namespace_nor_rviz_from_its_command_line(launched: Launched) -> None:
    assert "takes no argument rviz" in launched.refused("depth.launch.xml", "rviz:=true")


@pytest.mark.parametrize("file", FILES)
def test_arguments_of_an_including_file_are_its_own_and_those_like_ours_are_told(launched: Launched, file: str) -> None:
    stack = launched.including(
        '<arg name="vehicle"/><arg name="rviz" default="false"/>'
        '<push-ros-namespace namespace="car"/>' + INCLUDE.format(file, '<arg name="imgae_topic" value="/a"/>')
    )
    (node,) = launched.run(stack, "vehicle:=one")
    assert (node["namespace"], node["parameters"]) == ("/car", {})
    assert "no argument imgae_topic; if it is meant for it: did you mean image_topic?" in launched.output
    assert "no argument vehicle" not in launched.output


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("spelling", ["True", "true"])
def test_the_time_of_the_whole_stack_is_the_node_s(launched: Launched, file: str, spelling: str) -> None:
    stack = launched.including(f'<set_parameter name="use_sim_time" value="{spelling}"/>' + INCLUDE.format(file, ""))
    (node,) = launched.run(stack)
    assert node["parameters"] == {"use_sim_time": True}


@pytest.mark.parametrize(
    ("words", "is_simulated"), [((), True), (("use_sim_time:=False",), False), (("use_sim_time:=True",), True)]
)
def test_the_time_of_a_parameter_file_is_the_node_s_unless_it_is_given(
    launched: Launched, tmp_path: Path, words: tuple[str, ...], is_simulated: bool
) -> None:
    own = tmp_path / "own.yaml"
    own.write_text("/**: {ros__parameters: {use_sim_time: true}}", encoding="utf-8")
    for file in FILES:
        node = launched.run(file, f"params_file:={own}", *words)[-1]
        assert node["parameters"] == {"use_sim_time": is_simulated}


def test_both_spellings_of_true_and_false(launched: Launched) -> None:
    words = ("use_sim_time:=True", "autostart:=False", "image_is_rectified:=True", "respawn:=False", "rviz:=False")
    (node,) = launched.run("depth.launch.py", *words)
    assert node["parameters"] == {"use_sim_time": True, "autostart": False, "image_is_rectified": True}


@pytest.mark.parametrize("file", ["depth.launch.py", "multi_camera.launch.py", "replay.launch.py"])
def test_rviz_that_is_not_installed_is_told_and_nothing_is_started(launched: Launched, file: str) -> None:
    words = {"multi_camera.launch.py": ("cameras:=front,left",), "replay.launch.py": ("bag:=drive.mcap",)}
    line = launched.refused(file, *words.get(file, ()), "rviz:=true")
    assert "rviz:=true needs the package rviz2, which is not installed" in line


def test_rviz_shows_what_the_node_writes(launched: Launched) -> None:
    launched.install("rviz2", "rviz2")
    words = ("rviz:=True", "namespace:=front", "output/preview:=/shown", "use_sim_time:=true")
    (node,) = launched.run("depth.launch.py", *words)
    (rviz,) = launched.started("rviz2")
    assert rviz["parameters"] == {"use_sim_time": True}
    assert node["topics"]["depth/preview"] == "/shown"


def test_lists_are_lists(launched: Launched) -> None:
    words = ("radar_topics:=/a,/b", "radar_frame:=ra,rb", "radar_time_offset_s:=0.0,-0.05")
    (node,) = launched.run("depth.launch.py", *words)
    parameters = {"radar_topics": ["/a", "/b"], "radar_frame": ["ra", "rb"], "radar_time_offset_s": [0.0, -0.05]}
    assert node["parameters"] == parameters


def test_the_documented_launch_with_nav2_s_lifecycle_manager(launched: Launched) -> None:
    page = (ROOT / "docs" / "tutorials" / "nav2.md").read_text(encoding="utf-8")
    (example,) = [block.partition("\n```")[0] for block in page.split("```xml\n")[1:]]
    launched.install("nav2_lifecycle_manager", "lifecycle_manager")
    config = launched.share_of("my_vehicle_launch") / "config"
    config.mkdir()
    for camera in ("front", "rear"):
        text = f"/**: {{ros__parameters: {{camera_frame: {camera}}}}}"
        (config / f"{camera}.yaml").write_text(text, encoding="utf-8")
    stack = launched.including(example.removeprefix("<launch>").removesuffix("</launch>"))
    nodes = launched.run(stack, "use_sim_time:=True")
    for node, camera in zip(nodes, ("front", "rear"), strict=True):
        parameters = {"use_sim_time": True, "camera_frame": camera, "output_size": "network", "autostart": False}
        assert (node["namespace"], node["parameters"]) == (f"/{camera}", parameters)
        assert node["topics"] == {topic: f"/{camera}/{topic}" for topic in node["topics"]}
    (manager,) = launched.started("lifecycle_manager")
    base = manager["namespace"].rstrip("/")
    names = [f"{base}/{name}" for name in manager["parameters"].pop("node_names")]
    assert sorted(names) == [f"{node['namespace'].rstrip('/')}/{node['name']}" for node in nodes]
    assert manager["parameters"] == {
        "use_sim_time": True,
        "autostart": True,
        "bond_timeout": 0.0,
        "service_timeout": 30.0,
    }


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
