"""What the node says of an input on which nothing comes, by what else is there in the ROS graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.node.topics.graph import Graph, mismatches
from radcam_depth_ros.node.topics.inputs import TRANSPORT_TYPES, Input

RAW, COMPRESSED = TRANSPORT_TYPES["raw"], TRANSPORT_TYPES["compressed"]
INFO, CLOUD = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
CAMERA = Input("camera", "/image", RAW, 2, parameter="image_topic")
CAMERA_INFO = Input("camera_info", "/camera_info", INFO, 2, parameter="camera_info_topic")
RADAR = Input("radar", "/radar/points", CLOUD, 10, parameter="radar_topics")


@pytest.fixture
def own(context: Context) -> Iterator[Node]:
    node = Node("own", context=context, start_parameter_services=False, enable_rosout=False)
    yield node
    node.destroy_node()


@pytest.fixture
def graph(own: Node, peer: Any) -> Callable[..., Graph]:
    """The graph once these topics are published, by name and type."""

    def advertised(topics: dict[str, str], **qos: Any) -> Graph:
        for topic, type_name in topics.items():
            peer.advertise(topic, type_name, **qos)
        peer.until(lambda: all(own.count_publishers(topic) for topic in topics), what="discovery")
        return Graph(own, (CAMERA.topic, CAMERA_INFO.topic, RADAR.topic))

    return advertised


def test_of_what_nobody_publishes_the_nearest_topic_of_its_type_is_proposed(graph: Callable[..., Graph]) -> None:
    seen = graph(
        {
            "/front/image_raw": RAW,
            "/thermal/picture": RAW,
            "/front/camera_info": INFO,
            "/rear/camera_info": INFO,
            "/radar_front/points": CLOUD,
            "/lidar/cloud": CLOUD,
        }
    )
    assert seen.publishers(CAMERA, CAMERA.qos) == "no publishers"
    words = seen.remedy(CAMERA, CAMERA.qos)
    assert words.startswith("nobody publishes it; of this type there is /front/image_raw: set image_topic to it")
    assert "/radar_front/points: set radar_topics" in seen.remedy(RADAR, RADAR.qos)
    assert "/rear/camera_info" in seen.remedy(CAMERA_INFO, CAMERA_INFO.qos, beside="/rear/image")


def test_own_outputs_and_other_inputs_are_not_proposed(graph: Callable[..., Graph], own: Node) -> None:
    own.create_publisher(message_class(RAW), "/depth/image_rect", 1)
    second = Input("radar", "/radar/other", CLOUD, 10, parameter="radar_topics")
    seen = graph({RADAR.topic: CLOUD})
    assert "nor anything else of this type" in seen.remedy(CAMERA, CAMERA.qos)
    assert "nor anything else of this type" in seen.remedy(second, second.qos)


def test_outputs_of_another_node_of_this_kind_are_not_proposed(
    graph: Callable[..., Graph], own: Node, context: Context
) -> None:
    seen = graph({"/ahead/picture": RAW})
    other = Node("renamed", context=context, namespace="left", start_parameter_services=False, enable_rosout=False)
    try:
        for output in OUTPUTS.values():
            other.create_publisher(message_class(output.type_name), output.topic, 1)
        while own.count_publishers("/left/depth/points") == 0:
            time.sleep(0.02)
        assert "there is /ahead/picture: set image_topic" in seen.remedy(CAMERA, CAMERA.qos)
        assert "nor anything else of this type" in seen.remedy(RADAR, RADAR.qos)
        assert "nor anything else of this type" in seen.remedy(CAMERA_INFO, CAMERA_INFO.qos)
    finally:
        other.destroy_node()


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ({"/image/compressed": COMPRESSED}, "set image_transport to compressed and image_topic to /image/compressed"),
        ({"/image": COMPRESSED}, "set image_transport to compressed_topic and image_topic to /image"),
        ({"/image": CLOUD}, f"it is published as {CLOUD}: set image_topic to a topic of {RAW}"),
    ],
)
def test_another_type_is_named_with_what_to_set(
    graph: Callable[..., Graph], topics: dict[str, str], words: str
) -> None:
    seen = graph(topics)
    assert words in seen.remedy(CAMERA, CAMERA.qos)
    if CAMERA.topic in topics:
        assert seen.publishers(CAMERA, CAMERA.qos) == f"1 publisher: 1 of {topics[CAMERA.topic]}"


def test_a_topic_whose_name_is_fixed_is_remapped(graph: Callable[..., Graph]) -> None:
    transforms = Input("transforms", "/transforms", INFO, 2, otherwise="start their publisher")
    seen = graph({"/robot/transforms": INFO})
    assert seen.remedy(transforms, transforms.qos).endswith("there is /robot/transforms: remap /transforms to it")
    assert "remap /transforms to a topic of" in graph({"/transforms": CLOUD}).remedy(transforms, transforms.qos)
    alone = Input("transforms", "/transforms_static", RAW, 2, otherwise="start their publisher")
    assert "of this type: start their publisher, and see that" in seen.remedy(alone, alone.qos)


def test_a_quality_of_service_that_does_not_match_is_named_by_policy(graph: Callable[..., Graph]) -> None:
    seen = graph({CAMERA.topic: RAW}, reliability=ReliabilityPolicy.BEST_EFFORT)
    asked = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    assert seen.publishers(CAMERA, asked) == "1 publisher: 1 with RELIABILITY best_effort"
    assert "set the parameter qos_overrides./image.subscription.reliability to best_effort" in seen.remedy(
        CAMERA, asked
    )
    assert seen.publishers(CAMERA, CAMERA.qos) == "1 publisher"
    assert "which is silent" in seen.remedy(CAMERA, CAMERA.qos)


def test_only_less_than_what_is_asked_for_is_a_mismatch() -> None:
    latched = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    plain = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
    assert mismatches(latched, plain) == ()
    assert mismatches(plain, latched) == (("RELIABILITY", "best_effort"), ("DURABILITY", "volatile"))
