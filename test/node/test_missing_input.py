"""What the live node says when something that it needs does not come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.qos import ReliabilityPolicy

from radcam_depth_ros.node import watchdog

RADAR = "radar /radar/points"


def test_no_camera_info(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect("camera_info")
    status = bench.send_until(lambda: bench.status("calibration", "no usable camera_info"), what="its line")
    assert status.level == b"\x02"
    assert "/camera_info" in status.message
    bench.until(lambda: [line for line in bench.logs if "no usable camera_info" in line])
    bench.connect()
    bench.await_depth()
    assert len([line for line in bench.logs if "no usable camera_info" in line]) == 1


def test_the_log_has_an_error_s_sentence_once(start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.3)
    bench = start()
    bench.connect()
    info = bench.camera_info()
    info.k[0] = info.p[0] = 0.0
    bench.send_until(
        lambda: [line for line in bench.logs if "no depth for" in line],
        lambda: bench.send_pair(camera_info=info),
        what="its line",
    )
    assert len([line for line in bench.logs if "calibrate the camera" in line]) == 1
    (line,) = [line for line in bench.logs if "no depth for" in line]
    assert "camera_info:" in line
    # Diagnostics are read one at a time: each has all of it.
    bench.send_until(lambda: "calibrate the camera" in bench.diagnostics[-1]["output"].message)


def test_no_transform(start: Callable[..., Any], extrinsics: list[float]) -> None:
    bench = start(camera_from_radar=None)
    bench.connect()
    status = bench.send_until(lambda: bench.status("calibration", "camera_from_radar"), what="its line")
    assert status.level == b"\x02"
    assert "/tf_static" in status.message
    bench.until(lambda: [line for line in bench.logs if "camera_from_radar" in line])
    assert not any(map(len, bench.fake.radar_m.values()))
    assert bench.change_state("deactivate")
    assert bench.change_state("cleanup")
    assert bench.set_parameter("camera_from_radar", extrinsics) == ""
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.await_depth()
    assert len([line for line in bench.logs if "camera_from_radar" in line]) == 1


def test_a_publisher_that_cannot_be_heard_is_named_with_its_policy(start: Callable[..., Any]) -> None:
    bench = start(args=["-p", "qos_overrides./image.subscription.reliability:=reliable"])
    bench.advertise("image", "sensor_msgs/msg/Image", reliability=ReliabilityPolicy.BEST_EFFORT)
    status = bench.until(lambda: bench.status("camera", "RELIABILITY"), what="a line about the camera")
    assert "/image" in status.message
    assert "qos_overrides./image.subscription.reliability" in status.message


def test_without_any_input_one_line_says_what_is_missing(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.3)
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.3)
    bench = start()
    bench.until(lambda: [line for line in bench.logs if "no depth for" in line])
    bench.until(lambda: bench.status("camera", "nobody publishes it"))
    bench.until(lambda: bench.status(RADAR, "radar_msgs/msg/RadarScan on /radar/points, got nothing"))
    (line,) = [line for line in bench.logs if "no depth for" in line]
    for topic in ("sensor_msgs/msg/Image on /image (no publishers)", "/camera_info", "/radar/points"):
        assert topic in line
    assert bench.diagnostics[-1]["output"].level == b"\x02"
    bench.connect()
    bench.await_depth()


def test_before_the_first_depth_one_line_says_what_there_is_in_place_of_what_is_missing(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = start(autostart=False)
    for topic, type_name in {
        "image": "Image",
        "front/camera_info": "CameraInfo",
        "radar_front/points": "PointCloud2",
    }.items():
        bench.advertise(topic, f"sensor_msgs/msg/{type_name}")
    bench.until(lambda: bench.node.count_publishers("/radar_front/points"), what="discovery")
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.send_until(lambda: bench.status("camera", "Hz on /image"), what="images")
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.1)
    bench.send_until(lambda: bench.status("output", "no depth for"), what="its line")
    words = (
        "(1) images come, but no sensor_msgs/msg/CameraInfo on /camera_info (no publishers): nobody publishes it; of "
        "this type there is /front/camera_info: set camera_info_topic to it",
        "(2) sensor_msgs/msg/PointCloud2 or radar_msgs/msg/RadarScan on /radar/points (no publishers): nobody "
        "publishes it; of this type there is /radar_front/points: set radar_topics to it",
    )
    bench.until(lambda: [line for line in bench.logs if all(part in line for part in words)], what="it in the log")
    bench.diagnostics.clear()
    bench.until(lambda: len(bench.diagnostics) > 2)
    assert all(part in bench.diagnostics[-1]["output"].message for part in words)
    assert len([line for line in bench.logs if "no depth for" in line]) == 1


def test_odometry_that_is_needed_is_missed_like_a_sensor(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.3)
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.3)
    bench = start(radar_sweeps=3, odometry_topic="odom")
    bench.advertise("filter/odometry", "nav_msgs/msg/Odometry")
    words = "nobody publishes it; of this type there is /filter/odometry: set odometry_topic to it, or remap /odom"
    status = bench.until(lambda: bench.status("odometry", words), what="its status")
    assert status.level == b"\x01"
    what = "nav_msgs/msg/Odometry on /odom (no publishers): nobody publishes it"
    bench.until(lambda: bench.status("output", what), what="what is missing")
    bench.until(lambda: [line for line in bench.logs if "no depth for" in line and "/odom (" in line])


def test_no_radar_is_a_degraded_mode_that_is_named(start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.3)
    bench = start()
    bench.connect("radar/points")
    bench.await_depth()
    status = bench.send_until(lambda: bench.status(RADAR, "got nothing for"), what="a line about the radar")
    assert status.level == b"\x01"
    assert bench.send_until(lambda: bench.status("pairing", "had no radar sweep within"), what="a line about pairing")


def test_a_defect_in_the_network_skips_the_frame(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    bench.await_depth()
    bench.fake.error = ZeroDivisionError("of the network")
    status = bench.send_until(lambda: bench.status("inference", "ZeroDivisionError: of the network"), what="its line")
    assert status.level == b"\x02"
    bench.fake.error = None
    bench.await_depth()
    bench.send_until(lambda: bench.diagnostics[-1]["inference"].level == b"\x00", what="recovery")
