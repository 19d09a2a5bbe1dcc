"""Extrinsics over `/tf_static` and `/tf`, live."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy
from tf2_messages import require_tf2_msgs

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import StampedTransform, encode_transforms
from radcam_depth_ros.node.factory import build_message

require_tf2_msgs()

TFMESSAGE = "tf2_msgs/msg/TFMessage"
CAMERA_FROM_BASE = RigidTransform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros(3))
BASE_FROM_RADAR = RigidTransform(np.eye(3), np.array([0.0, 0.0, -0.5]))


def transforms(*frames: str) -> Any:
    """The sensors on their base link, those of them that are given."""
    links = {"camera": CAMERA_FROM_BASE.inverse(), "radar": BASE_FROM_RADAR}
    return encode_transforms(build_message, [StampedTransform("base_link", name, 0, links[name]) for name in frames])


def latch(bench: Any, message: Any) -> None:
    bench.advertise("/tf_static", TFMESSAGE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bench.send("/tf_static", message)


def test_a_node_that_starts_late_hears_latched_transforms(start: Callable[..., Any], peer: Any) -> None:
    latch(peer, transforms("camera", "radar"))
    bench = start(camera_from_radar=None)
    bench.connect()
    bench.await_depth()
    bench.until(lambda: bench.status("calibration", "96 x 64 pixels"), what="a calibration that is well")


def test_without_transforms_the_node_says_so_and_goes_on_when_they_come(start: Callable[..., Any]) -> None:
    bench = start(camera_from_radar=None)
    bench.connect()
    status = bench.send_until(lambda: bench.status("calibration", "camera_from_radar"), what="its line")
    assert "/tf_static" in status.message
    latch(bench, transforms("camera"))
    bench.send_until(lambda: bench.status("calibration", "'radar'"), what="the frame that is missing")
    bench.send("/tf_static", transforms("radar"))
    bench.await_depth()


@pytest.mark.parametrize(("kind", "parameter"), [("image", "camera_frame"), ("cloud", "radar_frame")])
def test_messages_without_a_frame_are_named_and_a_parameter_mends_them(
    start: Callable[..., Any], kind: str, parameter: str
) -> None:
    bench = start(camera_from_radar=None)
    bench.connect()
    latch(bench, transforms("camera", "radar"))
    bench.await_depth()
    bench.send_until(
        lambda: bench.status("calibration", parameter),
        lambda: bench.send_pair(**{kind: getattr(bench, kind)(frame_id="")}),
    )
    bench.await_depth()
    assert len([line for line in bench.logs if f"parameter {parameter}" in line]) == 1
    assert bench.change_state("deactivate")
    assert bench.change_state("cleanup")
    assert bench.set_parameter(parameter, "camera" if kind == "image" else "radar") == ""
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.await_depth(lambda: bench.send_pair(**{kind: getattr(bench, kind)(frame_id="")}))
    assert bench.depth[-1].header.frame_id == "camera"


def test_a_publisher_of_transforms_that_is_not_latched_is_named(start: Callable[..., Any]) -> None:
    bench = start(camera_from_radar=None)
    bench.advertise("/tf_static", TFMESSAGE)
    status = bench.until(lambda: bench.status("calibration", "DURABILITY"), what="the policy")
    assert "/tf_static" in status.message


def test_a_transform_that_is_none_is_named(start: Callable[..., Any]) -> None:
    bench = start(camera_from_radar=None)
    bench.connect()
    message = transforms("camera", "radar")
    message.transforms[0].transform.rotation.w = message.transforms[0].transform.rotation.x = 0.0
    message.transforms[0].transform.rotation.y = message.transforms[0].transform.rotation.z = 0.0
    latch(bench, message)
    status = bench.send_until(lambda: bench.status("calibration", "quaternion"), what="its line")
    assert "camera" in status.message
    bench.send("/tf_static", transforms("camera", "radar"))
    bench.await_depth()
