"""A bag played over DDS to a subscriber of another context."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from small_drive import START_NS

from radcam_depth_ros.bag_player import Playback, PlayOptions, Progress

TIMEOUT_S = 60


class Heard(Exception):  # noqa: N818  # no error: the way out of a playback that loops
    pass


def test_subscribers_hear_messages_and_the_clock(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=("/tf_static",))
    enough, ended = threading.Event(), threading.Event()

    def stop_when_heard(_: Progress) -> None:
        if enough.is_set():
            raise Heard

    def play() -> None:
        try:
            Playback(drive, PlayOptions(rate=2.0, loop=True, clock=True, delay_s=0.0)).run(stop_when_heard)
        except Heard:
            ended.set()

    context = Context()
    rclpy.init(args=[], context=context)
    node = Node("listener", context=context, start_parameter_services=False, enable_rosout=False)
    sweeps: list[Any] = []
    clocks: list[Any] = []
    node.create_subscription(PointCloud2, "/radar/points", sweeps.append, QoSProfile(depth=10))
    node.create_subscription(Clock, "/clock", clocks.append, QoSProfile(depth=10))
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    player = threading.Thread(target=play)
    player.start()
    deadline_s = time.monotonic() + TIMEOUT_S
    while not (len(sweeps) >= 8 and clocks) and time.monotonic() < deadline_s:
        executor.spin_once(timeout_sec=0.1)
    enough.set()
    player.join(TIMEOUT_S)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert ended.is_set()
    assert len(sweeps) >= 8
    stamps_ns = [sweep.header.stamp.sec * 1_000_000_000 + sweep.header.stamp.nanosec for sweep in sweeps]
    assert {stamp_ns % 100_000_000 for stamp_ns in stamps_ns} == {80_000_000}
    assert all((sweep.width, sweep.header.frame_id) == (4, "radar") for sweep in sweeps)
    assert all(clock.clock.sec * 1_000_000_000 + clock.clock.nanosec >= START_NS - 20_000_000 for clock in clocks)
