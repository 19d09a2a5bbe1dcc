"""Reading serialised messages, small ones at once and large ones in a thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from generated_messages import require_tf2_msgs
from rclpy.serialization import serialize_message

from radcam_depth_ros.geometry import MAX_LINKS, RigidTransform
from radcam_depth_ros.messages import StampedTransform, encode_points, encode_transforms
from radcam_depth_ros.node.topics.factory import build_message
from radcam_depth_ros.node.topics.inputs import TRANSFORM_TYPE, Input
from radcam_depth_ros.node.topics.reader import (
    MOST_TRANSFORM_BYTES,
    Reader,
    Reading,
    TooLargeError,
    UndecodableError,
)

RADAR = Input("radar", "/radar", "sensor_msgs/msg/PointCloud2", 3)
OTHER = Input("other radar", "/other", "sensor_msgs/msg/PointCloud2", 3)
STATIC = Input("transforms", "/tf_static", TRANSFORM_TYPE, 100)
INPUTS = (RADAR, OTHER, STATIC)


class Loop:
    """In place of a node and its executor: calls what was triggered when it is told to."""

    def __init__(self) -> None:
        self.triggered: queue.Queue[Callable[[], None]] = queue.Queue()
        self.is_destroyed = False

    def create_guard_condition(self, callback: Callable[[], None]) -> Any:
        return type("Guard", (), {"trigger": lambda _: self.triggered.put(callback)})()

    def destroy_guard_condition(self, guard: Any) -> None:
        self.is_destroyed = True

    def run_once(self) -> None:
        self.triggered.get(timeout=60)()


class Decoding:
    """A decoder that waits until it is let go on."""

    def __init__(self) -> None:
        self.begun: queue.Queue[str] = queue.Queue()
        self.go_on = threading.Semaphore(0)

    def __call__(self, topic: str, message: Any) -> str:
        name = str(message.header.frame_id)
        self.begun.put(name)
        assert self.go_on.acquire(timeout=60)
        return name


def cloud(name: str, points: int) -> bytes:
    x = np.zeros(points, np.float32)
    raw: bytes = serialize_message(encode_points(build_message, {"x": x, "y": x, "z": x}, 0, name))
    return raw


def large(name: str) -> bytes:
    return cloud(name, 30_000)


def links(count: int, child: str = "f") -> bytes:
    require_tf2_msgs()
    pose = RigidTransform.identity()
    entries = [StampedTransform("base", f"{child}{number}", 0, pose) for number in range(count)]
    raw: bytes = serialize_message(encode_transforms(build_message, entries))
    return raw


def contents(readings: list[Reading]) -> list[Any]:
    return [reading.content for reading in readings]


def test_a_small_message_is_read_before_the_call_returns() -> None:
    readings: list[Reading] = []
    reader = Reader(Loop(), INPUTS, lambda topic, message: (topic, message.header.frame_id), readings.append)
    reader.put(RADAR, cloud("a", 3), 7)
    (reading,) = readings
    assert (reading.content, reading.error, reading.arrived_ns) == (("/radar", "a"), None, 7)
    assert reading.decoded_ns > 0
    reader.close()


def test_messages_of_an_input_keep_their_order_and_inputs_take_turns() -> None:
    loop, decoding, readings = Loop(), Decoding(), []
    reader = Reader(loop, INPUTS, decoding, readings.append)
    reader.put(RADAR, large("a"), 0)
    decoding.begun.get(timeout=60)
    for source, raw in ((RADAR, large("b")), (RADAR, cloud("c", 3)), (OTHER, large("d"))):
        reader.put(source, raw, 0)
    assert [reader.pending(source.part) for source in (RADAR, OTHER)] == [3, 1]
    assert readings == []
    for _ in range(4):
        decoding.go_on.release()
        loop.run_once()
    assert contents(readings) == ["a", "d", "b", "c"]
    assert reader.pending(RADAR.part) == 0
    decoding.go_on.release()
    reader.put(RADAR, cloud("e", 3), 0)
    assert contents(readings)[-1] == "e"
    reader.close()


def test_of_more_than_an_inputs_depth_the_oldest_are_dropped_and_counted() -> None:
    loop, decoding, readings = Loop(), Decoding(), []
    reader = Reader(loop, INPUTS, decoding, readings.append)
    reader.put(RADAR, large("a"), 0)
    assert decoding.begun.get(timeout=60) == "a"
    for name in "bcdefg":
        reader.put(RADAR, large(name), 0)
    assert reader.dropped == {"radar": 3}
    assert reader.pending("radar") == 4
    for _ in range(4):
        decoding.go_on.release()
        loop.run_once()
    assert contents(readings) == ["a", "e", "f", "g"]
    reader.close()


def test_what_is_read_after_the_end_is_not_handed_back() -> None:
    loop, decoding, readings = Loop(), Decoding(), []
    reader = Reader(loop, INPUTS, decoding, readings.append)
    reader.put(RADAR, large("a"), 0)
    decoding.begun.get(timeout=60)
    reader.close(timeout_s=0.0)
    assert loop.is_destroyed
    decoding.go_on.release()
    assert reader._thread is not None
    reader._thread.join(60)
    reader.put(RADAR, cloud("b", 3), 0)
    assert readings == []
    assert loop.triggered.empty()


@pytest.mark.parametrize(
    "raw",
    [b"", b"\x00\x01", cloud("a", 3)[:40], b"\x00\x01\x00\x00" + b"\xff" * 60],
    ids=["empty", "short header", "cut", "counts beyond its end"],
)
def test_bytes_that_are_no_message_are_named(raw: bytes) -> None:
    readings: list[Reading] = []
    reader = Reader(Loop(), INPUTS, lambda topic, message: None, readings.append)
    for source in (RADAR, STATIC):
        reader.put(source, raw, 0)
        error = readings[-1].error
        assert isinstance(error, UndecodableError)
        assert f"expected messages of {source.type_name} on {source.topic}, got bytes that are none" in str(error)
    reader.close()


@pytest.mark.parametrize(("count", "is_taken"), [(10, True), (MAX_LINKS, True), (1001, False)])
def test_transforms_are_bounded_before_they_are_decoded(count: int, is_taken: bool) -> None:
    raw, loop, readings = links(count), Loop(), []
    reader = Reader(loop, INPUTS, lambda topic, message: len(message.transforms), readings.append)
    reader.put(STATIC, raw, 0)
    if not readings:
        loop.run_once()
    (reading,) = readings
    assert (reading.error is None) == is_taken
    if not is_taken:
        assert isinstance(reading.error, TooLargeError)
        assert "expected at most 1000 transforms in 512 KiB in a message on /tf_static, got 1001 in" in str(
            reading.error
        )
    reader.close()


def test_transforms_with_very_long_names_are_bounded_too() -> None:
    readings: list[Reading] = []
    reader = Reader(Loop(), INPUTS, lambda topic, message: None, readings.append)
    raw = links(10, "x" * (MOST_TRANSFORM_BYTES // 10))
    reader.put(STATIC, raw, 0)
    assert isinstance(readings[0].error, TooLargeError)
    reader.close()
