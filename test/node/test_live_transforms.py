"""Extrinsics over `/tf_static` and `/tf`, live."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from generated_messages import require_tf2_msgs
from rclpy.qos import DurabilityPolicy

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import StampedTransform, encode_transforms
from radcam_depth_ros.node import watchdog
from radcam_depth_ros.node.topics.factory import build_message, message_class

require_tf2_msgs()

TFMESSAGE = "tf2_msgs/msg/TFMessage"
CAMERA_FROM_BASE = RigidTransform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros(3))
BASE_FROM_RADAR = RigidTransform(np.eye(3), np.array([0.0, 0.0, -0.5]))
SIDE = RigidTransform(np.eye(3), np.array([0.0, -0.4, 0.1]))


MAST_FROM_PAN = RigidTransform(np.eye(3), np.array([0.1, 0.0, 0.3]))
BASE_FROM_MAST = RigidTransform(np.eye(3), np.array([-0.5, 0.2, 1.2]))
AHEAD_NS = 300_000_000
"""So much later than the images are the poses that are sent with them."""
POINTS_M = np.array([[10.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
"""What the peer's radar sees."""


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


def test_a_transform_that_contradicts_a_static_one_is_told_with_who_publishes_it_and_moves_nothing(
    start: Callable[..., Any],
) -> None:
    bench = start(camera_from_radar=None)
    bench.connect()
    latch(bench, transforms("camera", "radar"))
    bench.await_depth()
    stray = StampedTransform("base_link", "radar", 0, RigidTransform(np.eye(3), np.array([15.0, 0.0, -0.5])))
    bench.advertise("/tf", TFMESSAGE)
    status = bench.send_until(
        lambda: bench.status("calibration", "15.00 m"),
        lambda: bench.send("/tf", encode_transforms(build_message, [stray])),
        what="the conflict",
    )
    assert status.level == b"\x01"
    assert "/tf_static is published by" in status.message
    assert "/tf is published by" in status.message
    pose = bench.node._session.frame_builder.transforms.lookup("base_link", "radar")
    np.testing.assert_allclose(pose.translation, BASE_FROM_RADAR.translation)


def turned(stamp_ns: int) -> RigidTransform:
    """A mount that turns to the left by 0.4 rad/s."""
    half = 0.2e-9 * (stamp_ns % 1_000_000_000_000)
    return RigidTransform.from_quaternion(MAST_FROM_PAN.translation, (0.0, 0.0, math.sin(half), math.cos(half)))


def link(parent: str, child: str, pose: RigidTransform, stamp_ns: int = 0) -> Any:
    return encode_transforms(build_message, [StampedTransform(parent, child, stamp_ns, pose)])


def send_between_poses(bench: Any) -> None:
    """The mount's pose of a later time, and a pair of half a step after the pose that was sent three steps ago."""
    bench.send("/tf", link("mast", "pan", turned(bench.now_ns + AHEAD_NS), bench.now_ns + AHEAD_NS))
    now_ns = bench.now_ns
    bench.now_ns = now_ns - 50_000_000
    bench.send_pair()
    bench.now_ns = now_ns


def with_returns(bench: Any, number: int = 2) -> list[tuple[int, np.ndarray]]:
    """Stamps and returns of the frames that have so many."""
    return [(stamp_ns, xyz_m) for stamp_ns, xyz_m in list(bench.fake.radar_m.items()) if len(xyz_m) == number]


def test_a_camera_that_pans_is_where_tf_has_it_at_the_images_stamp(start: Callable[..., Any]) -> None:
    bench = start(camera_from_radar=None)
    fixed = [("base_link", "mast", BASE_FROM_MAST), ("pan", "camera", CAMERA_FROM_BASE.inverse())]
    links = [StampedTransform(parent, child, 0, pose) for parent, child, pose in fixed]
    links += [StampedTransform("base_link", "bumper", 0, BASE_FROM_RADAR), StampedTransform("bumper", "radar", 0, SIDE)]
    latch(bench, encode_transforms(build_message, links))
    bench.connect()
    # All but the moving link is there.
    bench.send_until(lambda: bench.status("calibration", "two trees"), what="what is missing")
    assert not with_returns(bench)
    bench.advertise("/tf", TFMESSAGE)
    bench.send_until(lambda: len(with_returns(bench)) >= 8, lambda: send_between_poses(bench), what="frames")
    for stamp_ns, found_m in with_returns(bench)[4:]:
        base_from_camera = BASE_FROM_MAST @ turned(stamp_ns) @ CAMERA_FROM_BASE.inverse()
        expected_m = base_from_camera.inverse().apply((BASE_FROM_RADAR @ SIDE).apply(POINTS_M))
        np.testing.assert_allclose(found_m, expected_m, atol=5e-3)


def test_several_sweeps_are_taken_once_tf_tells_how_the_vehicle_moves(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.3)
    # The peer's Doppler does not know that the vehicle drives.
    bench = start(camera_from_radar=None, radar_sweeps=3, odom_frame="odom", radar_fields="radial_speed=")
    latch(bench, transforms("camera", "radar"))
    bench.connect()
    bench.await_depth()
    words = "expected tf2_msgs/msg/TFMessage on /tf, got nothing"
    status = bench.send_until(lambda: bench.status("moving transforms", words), what="its line")
    assert "nobody publishes it" in status.message
    bench.advertise("/tf", TFMESSAGE)

    def send() -> None:
        driven = RigidTransform(np.eye(3), np.array([5e-9 * (bench.now_ns % 1_000_000_000_000), 0.0, 0.0]))
        bench.send("/tf", link("odom", "base_link", driven, bench.now_ns))
        bench.send_pair()

    found = bench.send_until(lambda: with_returns(bench, 6), send, what="all sweeps")
    # The peer's radar sees the same in each sweep, though the vehicle drives on: 0.5 m between two sweeps.
    np.testing.assert_allclose(found[-1][1][:, 2].reshape(3, 2), [[10, 20], [9.5, 19.5], [9, 19]], atol=1e-3)
    bench.send_until(lambda: bench.diagnostics[-1]["moving transforms"].level == b"\0", send, what="/tf that is well")


def test_without_any_input_transforms_are_missed_like_a_sensor(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.3)
    bench = start(camera_from_radar=None, radar_sweeps=3)
    bench.peer.create_publisher(message_class(TFMESSAGE), "/robot/tf_static", 1)
    words = (
        "tf2_msgs/msg/TFMessage on /tf_static (no publishers): nobody publishes it; of this type there is "
        "/robot/tf_static: remap /tf_static to it",
        "tf2_msgs/msg/TFMessage on /tf (no publishers): nobody publishes it, nor anything else of this type",
    )
    status = bench.until(lambda: bench.status("output", words[0]), what="what is missing")
    assert words[1] in status.message
    bench.until(lambda: [line for line in bench.logs if "no depth for" in line and "TFMessage on /tf_static" in line])
    bench.connect()
    bench.send_until(lambda: bench.status("calibration", "remap /tf_static to it"), what="the remedy")
