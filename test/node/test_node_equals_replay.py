from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated_messages import require_tf2_msgs
from rclpy.qos import DurabilityPolicy
from small_drive import CAMERA, CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_image, small_messages, small_returns
from typer.testing import CliRunner

from radcam_depth_ros import cli
from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    OdometryReading,
    StampedTransform,
    decode_depth,
    encode_camera_info,
    encode_image,
    encode_odometry,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.node.topics.factory import build_message
from radcam_depth_ros.replay import replay

FRAMES = 4
EXTRINSICS = tuple(float(value) for value in (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion))
TOPICS = {"/camera/image_raw": "image", "/camera/camera_info": "camera_info", "/radar/points": "radar/points"}


@pytest.mark.usefixtures("number_format")
def test_the_live_node_and_the_replay_give_the_same_depth(
    start: Callable[..., Any], write_drive: Callable[..., Path], small_weights: Path, tmp_path: Path
) -> None:
    estimator = Estimator(EstimatorConfig(model_file=str(small_weights)))
    replay(
        write_drive(tmp_path / "drive.mcap", FRAMES),
        tmp_path / "depth.mcap",
        estimator,
        DriveSettings(FrameBuilderConfig(camera_from_radar=EXTRINSICS)),
    )
    bench = start(Estimator, model_file=str(small_weights), camera_from_radar=list(EXTRINSICS), max_wait_s=0.1)
    semi_dense: list[Any] = []
    bench.subscribe("semi_dense/image_rect", "sensor_msgs/msg/Image", semi_dense.append)
    bench.connect()

    def play(index: int) -> None:
        for topic, _, message, _ in small_messages(build_message, index):
            if topic in TOPICS:
                bench.send(TOPICS[topic], message)

    for index in range(FRAMES):
        # Best effort may lose a message; sent again, it has the same stamp.
        bench.send_until(
            lambda index=index: len(semi_dense) > index and len(bench.depth) > index,
            lambda index=index: play(index),
            what="depth",
        )

    live = {
        (reading.stamp_ns, name): reading.depth_m
        for name, messages in (("depth", bench.depth), ("semi", semi_dense))
        for reading in map(decode_depth, messages)
    }
    with BagReader(tmp_path / "depth.mcap") as reader:
        for topic, name in (("/depth/image_rect", "depth"), ("/semi_dense/image_rect", "semi")):
            replayed = [decode_depth(message.message) for message in reader.messages([topic])]
            assert len(replayed) == FRAMES
            for reading in replayed:
                np.testing.assert_array_equal(live[reading.stamp_ns, name], reading.depth_m)
    assert np.isfinite(semi_dense_values := live[min(live)[0], "semi"]).any(), semi_dense_values


DEPTH_TOPICS = ("depth/image_rect", "semi_dense/image_rect")
CLOUD = "sensor_msgs/msg/PointCloud2"
STATIC = "tf2_msgs/msg/TFMessage"
VEHICLE = {
    "/front/image_raw": "sensor_msgs/msg/Image",
    "/front/camera_info": "sensor_msgs/msg/CameraInfo",
    "/radar_front/points": CLOUD,
    "/radar_corner/points": CLOUD,
    "/vehicle/odometry": "nav_msgs/msg/Odometry",
}
PARAMETERS = """
/**:
  ros__parameters:
    autostart: true
    image_topic: /front/image_raw
    radar_topics: [/radar_front/points, radar_corner/points]
    camera_frame: camera
    radar_frame: [radar_front, radar_corner]
    radar_fields: ["", "rcs=strength"]
    radar_time_offset_s: [0.0, -0.01]
    radar_sweeps: 3
    odometry_topic: /vehicle/odometry
    footprint_frame: road
    depth_encoding: 16UC1
    model_file: {model}
    precision: float32
    threads: 1
    # So that no sweep is lost on the way to the node.
    qos_overrides:
      /front/image_raw: {{subscription: {{reliability: reliable}}}}
      /radar_front/points: {{subscription: {{reliability: reliable, depth: 50}}}}
      /radar_corner/points: {{subscription: {{reliability: reliable, depth: 50}}}}
      /vehicle/odometry: {{subscription: {{reliability: reliable}}}}
"""


def vehicle_frames(make: Any) -> Any:
    """Where the sensors are, and the road, which has a name of its own."""
    places = {
        "camera": RigidTransform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.2, 0.0, 1.3])),
        "radar_front": RigidTransform(np.eye(3), np.array([1.2, 0.1, 0.6])),
        "radar_corner": RigidTransform(np.eye(3), np.array([1.0, -0.3, 0.7])),
        "road": RigidTransform(np.eye(3), np.array([0.0, 0.0, -0.25])),
    }
    return encode_transforms(make, [StampedTransform("base_link", name, 0, pose) for name, pose in places.items()])


def vehicle_messages(make: Any, index: int) -> list[tuple[str, Any, int]]:
    """One frame of a vehicle at 5 m/s with two radars; no image and no cloud has a frame_id."""
    stamp_ns = START_NS + index * PERIOD_NS
    messages: list[tuple[str, Any, int]] = []
    for before_ns in (90_000_000, 50_000_000, 0):
        time_ns = stamp_ns - before_ns
        pose = RigidTransform(np.eye(3), np.array([5e-9 * (time_ns - START_NS), 0.0, 0.0]))
        reading = OdometryReading(time_ns, "odom", "base_link", pose, np.array([5.0, 0, 0]), np.zeros(3))
        messages.append(("/vehicle/odometry", encode_odometry(make, reading), time_ns))
    for topic, rcs, before_ns in (("/radar_front/points", "rcs", 30_000_000), ("/radar_corner/points", "strength", 0)):
        x, y, z = (small_returns(index) + len(rcs)).T
        columns = {"x": x, "y": y - len(rcs), "z": z - len(rcs), rcs: np.full(4, 9, np.float32)}
        messages.append((topic, encode_points(make, columns, stamp_ns - before_ns, ""), stamp_ns - before_ns))
    messages.append(("/front/camera_info", encode_camera_info(make, CAMERA, stamp_ns, ""), stamp_ns))
    messages.append(("/front/image_raw", encode_image(make, small_image(index), stamp_ns, ""), stamp_ns))
    return messages


def write_vehicle_drive(path: Path) -> Path:
    with BagWriter(path) as writer:
        writer.write("/tf_static", vehicle_frames(factory), START_NS - 200_000_000, STATIC)
        for index in range(FRAMES):
            for topic, message, time_ns in sorted(vehicle_messages(factory, index), key=lambda entry: entry[2]):
                writer.write(topic, message, time_ns, VEHICLE[topic])
    return path


def replayed(drive: Path, target: Path, *options: str) -> dict[tuple[int, str], bytes]:
    """Bytes of the depth images that `radcam-depth replay` writes, by stamp and topic."""
    result = CliRunner().invoke(cli.app, ["replay", str(drive), str(target), *options], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    with BagReader(target) as reader:
        messages = [(item.topic, item.message) for item in reader.messages([f"/{topic}" for topic in DEPTH_TOPICS])]
    return {(stamp_of(message), topic): bytes(message.data) for topic, message in messages}


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def test_one_parameter_file_gives_the_same_bytes_live_and_replayed(
    start: Callable[..., Any], small_weights: Path, tmp_path: Path
) -> None:
    require_tf2_msgs()
    file = tmp_path / "vehicle.yaml"
    file.write_text(PARAMETERS.format(model=small_weights), encoding="utf-8")
    drive = write_vehicle_drive(tmp_path / "drive.mcap")
    expected = replayed(drive, tmp_path / "depth.mcap", "--params", str(file))
    assert len(expected) == FRAMES * len(DEPTH_TOPICS)
    assert {len(data) for data in expected.values()} == {2 * CAMERA.width * CAMERA.height}
    # Sweeps and road reach the network: without them it gives other bytes.
    assert replayed(drive, tmp_path / "single.mcap", "--params", str(file), "--radar-sweeps", "1") != expected
    other = tmp_path / "other.yaml"
    other.write_text(file.read_text(encoding="utf-8").replace("footprint_frame: road", ""), encoding="utf-8")
    assert replayed(drive, tmp_path / "roadless.mcap", "--params", str(other)) != expected

    bench = start(Estimator, ("--params-file", str(file)), camera_from_radar=None, max_wait_s=None)
    live: dict[tuple[int, str], bytes] = {}
    for name in DEPTH_TOPICS:
        bench.subscribe(
            name,
            "sensor_msgs/msg/Image",
            lambda message, name=name: live.setdefault((stamp_of(message), f"/{name}"), bytes(message.data)),
        )
    bench.advertise("/tf_static", STATIC, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bench.send("/tf_static", vehicle_frames(build_message))
    for topic, type_name in VEHICLE.items():
        bench.advertise(topic, type_name)
    bench.connect("image", "camera_info", "radar/points")
    bench.until(lambda: bench.status("calibration", ""), what="the node's first diagnostics")
    for index in range(FRAMES):
        for topic, message, _ in vehicle_messages(build_message, index):
            bench.send(topic, message)
        bench.until(lambda index=index: len(live) == (index + 1) * len(DEPTH_TOPICS), what=f"depth of frame {index}")
    assert live == expected
