"""Where the node listens: images raw and compressed on topics of any name, and their calibration beside them."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.node import Node

from radcam_depth_ros.node.topics.inputs import find_inputs
from radcam_depth_ros.parameters import build_config

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


@pytest.mark.parametrize(
    ("parameters", "remaps", "image", "kind", "camera_info"),
    [
        ({}, (), "/car/image", RAW, "/car/camera_info"),
        ({}, ("image:=/a/b", "camera_info:=/a/c"), "/a/b", RAW, "/a/c"),
        ({"image_topic": "/cam0/color"}, (), "/cam0/color", RAW, "/cam0/camera_info"),
        ({"image_topic": "left/rgb", "camera_info_topic": "calib"}, (), "/car/left/rgb", RAW, "/car/calib"),
        (
            {"image_topic": "/cam0/color", "image_transport": "compressed"},
            (),
            "/cam0/color/compressed",
            COMPRESSED,
            "/cam0/camera_info",
        ),
        (
            {"image_topic": "/cam0/color/compressed", "image_transport": "compressed"},
            (),
            "/cam0/color/compressed",
            COMPRESSED,
            "/cam0/camera_info",
        ),
        ({"image_transport": "compressed"}, ("image:=/a/b",), "/a/b/compressed", COMPRESSED, "/car/camera_info"),
        (
            {"image_topic": "/cam0/color", "image_transport": "compressed"},
            ("/cam0/color/compressed:=/jpegs",),
            "/jpegs",
            COMPRESSED,
            "/cam0/camera_info",
        ),
        (
            {"image_topic": "/cam0/rect_compressed", "image_transport": "compressed_topic"},
            (),
            "/cam0/rect_compressed",
            COMPRESSED,
            "/cam0/camera_info",
        ),
    ],
)
def test_images_and_calibration_are_found_by_any_name(
    context: Any, parameters: dict[str, str], remaps: tuple[str, ...], image: str, kind: str, camera_info: str
) -> None:
    arguments = [word for remap in remaps for word in ("-r", remap)]
    node = Node("radcam_depth", context=context, namespace="car", cli_args=["--ros-args", *arguments])
    inputs = find_inputs(node, build_config(parameters))
    assert (inputs.camera.topic, inputs.camera.type_name) == (image, kind)
    assert (inputs.camera_info.topic, inputs.camera_info.type_name) == (camera_info, "sensor_msgs/msg/CameraInfo")
    node.destroy_node()
