"""config/sensors: every file is a valid parameter file of the node, and names the topics of its sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.node import Node

from radcam_depth_ros.bags import BagReader, find_topics
from radcam_depth_ros.node.parameters import Parameters
from radcam_depth_ros.parameters import PARAMETERS, NodeConfig

FOLDER = Path(__file__).parents[2] / "config" / "sensors"
FILES = sorted(FOLDER.glob("*.yaml"))
NAMES = {spec.name for spec in PARAMETERS}


def read(context: Any, path: Path) -> NodeConfig:
    """The file as the node reads it."""
    node = Node("radcam_depth", context=context, cli_args=["--ros-args", "--params-file", str(path)])
    config = Parameters(node).read()
    node.destroy_node()
    return config


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_node_takes_the_file(context: Any, path: Path) -> None:
    (section,) = yaml.safe_load(path.read_text(encoding="utf-8")).values()
    assert set(section["ros__parameters"]) <= NAMES, "a name that the node does not know"
    config = read(context, path)
    assert config != NodeConfig()
    assert config.frame_builder.radars != NodeConfig().frame_builder.radars
    assert all(topic.startswith("/") for topic in config.frame_builder.radars)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_file_says_which_fields_the_clouds_have(path: Path) -> None:
    comments = [line.lstrip("# ") for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    assert any(line.startswith("Fields of the clouds") for line in comments)


def test_astyx_is_as_its_bags_are(context: Any, astyx_val: Path) -> None:
    config = read(context, FOLDER / "astyx.yaml")
    with BagReader(astyx_val) as reader:
        topics = find_topics(reader.topics)
    assert topics.image == f"{config.frame_builder.image}/{config.image_transport}"
    assert (topics.camera_info, topics.radars) == (config.frame_builder.calibration_topic, config.frame_builder.radars)
