"""Several sweeps of a radar in the live node, moved by the vehicle's odometry."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from small_drive import CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_messages

from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import OdometryReading, decode_depth, encode_odometry
from radcam_depth_ros.node.topics.factory import build_message
from radcam_depth_ros.pairing import PairingConfig
from radcam_depth_ros.replay import replay

ODOMETRY = "nav_msgs/msg/Odometry"
SWEEPS = 3


def odometry(make: Any, stamp_ns: int, frame: str = "camera") -> Any:
    """The camera drives along its axis by 5 m/s; its frame is the vehicle's, for which no tree is needed."""
    pose = RigidTransform(np.eye(3), np.array([0.0, 0.0, 5e-9 * (stamp_ns - START_NS)]))
    return encode_odometry(make, OdometryReading(stamp_ns, "odom", frame, pose, np.zeros(3), np.zeros(3)))


def dense(message: Any) -> float:
    return float(decode_depth(message).depth_m[0, 0])


def test_a_node_takes_several_sweeps_once_it_hears_how_the_vehicle_moves(start: Callable[..., Any]) -> None:
    bench = start(radar_sweeps=SWEEPS, odometry_topic="odom")
    bench.connect()
    # The estimator's depth is the number of returns in view, two a sweep, and 1 m more.
    assert dense(bench.await_depth()) == 3
    status = bench.until(lambda: bench.status("pairing", "no odometry came on /odom"), what="its line")
    assert "odometry_topic" in status.message
    bench.advertise("odom", ODOMETRY)
    bench.send_until(
        lambda: bench.status("odometry", "Hz on /odom"),
        lambda: bench.send("odom", odometry(build_message, bench.now_ns, "odom")),
        what="a first message of a wrong frame",
    )

    def send() -> None:
        bench.send("odom", odometry(build_message, bench.now_ns))
        bench.send_pair()

    bench.send_until(lambda: dense(bench.depth[-1]) == 1 + 2 * SWEEPS, send, what="depth of all sweeps")
    bench.send_until(lambda: bench.diagnostics[-1]["pairing"].level == b"\0", send, what="pairing that is well")
    assert len([line for line in bench.logs if "cannot be moved" in line]) == 1
    assert len([line for line in bench.logs if "got child_frame_id 'camera' after 'odom'" in line]) == 1


def test_odometry_is_heard_only_where_it_is_needed(start: Callable[..., Any]) -> None:
    bench = start(odometry_topic="odom")
    bench.connect()
    bench.await_depth()
    assert bench.peer.count_subscribers("odom") == 0


def test_the_live_node_and_the_replay_move_sweeps_alike(
    start: Callable[..., Any], small_weights: Path, tmp_path: Path
) -> None:
    frames, extrinsics = 4, (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion)
    extrinsics = tuple(float(value) for value in extrinsics)
    topics = {"/camera/image_raw": "image", "/camera/camera_info": "camera_info", "/radar/points": "radar/points"}

    def messages(make: Any, index: int) -> list[tuple[str, str, Any, int]]:
        stamps = [START_NS + index * PERIOD_NS - before for before in (50_000_000, 20_000_000, 0)]
        poses = [("/odom", ODOMETRY, odometry(make, stamp), stamp) for stamp in stamps]
        return [*poses, *(row for row in small_messages(make, index) if row[0] in topics)]

    with BagWriter(tmp_path / "drive.mcap") as writer:
        for index in range(frames):
            for topic, type_name, message, time_ns in messages(factory, index):
                writer.write(topic, message, time_ns, type_name)
    pairing = PairingConfig(radar_sweeps=SWEEPS)
    estimator = Estimator(EstimatorConfig(model_file=str(small_weights)))
    settings = DriveSettings(FrameBuilderConfig(camera_from_radar=extrinsics, pairing=pairing))
    replay(tmp_path / "drive.mcap", tmp_path / "depth.mcap", estimator, settings)

    bench = start(
        Estimator,
        model_file=str(small_weights),
        camera_from_radar=list(extrinsics),
        max_wait_s=0.1,
        radar_sweeps=SWEEPS,
        odometry_topic="odom",
    )
    bench.advertise("odom", ODOMETRY)
    bench.connect()

    def play(index: int) -> None:
        for topic, _, message, _ in messages(build_message, index):
            bench.send(topics.get(topic, "odom"), message)

    for index in range(frames):
        bench.send_until(lambda index=index: len(bench.depth) > index, lambda index=index: play(index), what="depth")
    live = {reading.stamp_ns: reading.depth_m for reading in map(decode_depth, bench.depth)}
    with BagReader(tmp_path / "depth.mcap") as reader:
        replayed = [decode_depth(message.message) for message in reader.messages(["/depth/image_rect"])]
    assert len(replayed) == frames
    for reading in replayed:
        np.testing.assert_array_equal(live[reading.stamp_ns], reading.depth_m)
