from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from small_drive import CAMERA_FROM_RADAR, small_messages

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.intake import IntakeConfig
from radcam_depth_ros.messages import decode_depth
from radcam_depth_ros.node.factory import build_message
from radcam_depth_ros.replay import replay

FRAMES = 4
EXTRINSICS = tuple(float(value) for value in (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion))
TOPICS = {"/camera/image_raw": "image", "/camera/camera_info": "camera_info", "/radar/points": "radar/points"}


def test_the_live_node_and_the_replay_give_the_same_depth(
    start: Callable[..., Any], write_drive: Callable[..., Path], small_weights: Path, tmp_path: Path
) -> None:
    estimator = Estimator(EstimatorConfig(model_file=str(small_weights)))
    replay(
        write_drive(tmp_path / "drive.mcap", FRAMES),
        tmp_path / "depth.mcap",
        estimator,
        DriveSettings(IntakeConfig(camera_from_radar=EXTRINSICS)),
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
