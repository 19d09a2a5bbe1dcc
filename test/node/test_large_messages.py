"""Messages that take long to decode, or cannot be decoded: everything else goes on, and all is counted."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from generated_messages import require_tf2_msgs
from rclpy.serialization import serialize_message

from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import StampedTransform, encode_transforms
from radcam_depth_ros.node.topics.factory import build_message

TFMESSAGE = "tf2_msgs/msg/TFMessage"
RADAR = "radar /radar/points"
CLOUD_POINTS = 30_000
"""A cloud of so many is decoded in the reader's thread."""


def links(count: int, first: int = 0) -> bytes:
    require_tf2_msgs()
    pose = RigidTransform.identity()
    entries = [StampedTransform("nowhere", f"bogus{first + number}", 1, pose) for number in range(count)]
    raw: bytes = serialize_message(encode_transforms(build_message, entries))
    return raw


def values(bench: Any, part: str) -> dict[str, str]:
    return {value.key: value.value for value in bench.diagnostics[-1][part].values}


def known(session: Any, part: str) -> int:
    """Messages of which is known what became of them."""
    return int(session.used[part] + session.unusable[part] + session.reader.dropped[part] + session.lost[part].count)


def last_number(session: Any) -> int:
    """The publisher's number of the last image that came."""
    return int(session.lost["camera"]._last or 0)


def settled(bench: Any) -> tuple[int, int]:
    """The number of the last image, and of how many is known what became of them, once no more come."""
    session, seen = bench.node._session, []

    def is_settled() -> bool:
        time.sleep(0.2)
        seen.append((last_number(session), known(session, "camera")))
        return not session.reader.pending("camera") and seen[-1] == seen[-2:][0] and len(seen) > 1

    bench.until(is_settled, what="the end of the images")
    return seen[-1]


def send_images(bench: Any, count: int, period_s: float, beside: Callable[[int], None]) -> None:
    """Sends images at a steady rate, and what else is to go on beside."""
    start_s = time.monotonic()
    for number in range(count):
        bench.now_ns += round(period_s * 1e9)
        bench.send_pair()
        beside(number)
        due_s = start_s + (number + 1) * period_s
        bench.until(lambda due_s=due_s: time.monotonic() >= due_s)


@pytest.mark.parametrize(("size", "is_taken"), [(8000, False), (1000, True)])
def test_each_of_200_images_is_used_or_counted_beside_huge_transforms(
    start: Callable[..., Any], size: int, is_taken: bool
) -> None:
    bench = start()
    bench.advertise("/tf", TFMESSAGE)
    bench.connect()
    bench.await_depth()
    session = bench.node._session
    floods = [links(size, first) for first in (0, 4000)]
    used, first, before = session.used["camera"], *settled(bench)

    def beside(number: int) -> None:
        if number % 2 == 0:
            bench.send("/tf", floods[number // 2 % 2])
        if number == 100:
            bench.diagnostics.clear()
            assert bench.set_parameter("max_wait_s", 0.03) == ""
            bench.until(lambda: bench.diagnostics, what="diagnostics in the flood")

    send_images(bench, 200, 0.025, beside)
    # What was lost at the end shows in the number of the next image.
    bench.send_until(lambda: last_number(session) >= first + 200, what="the number of the last image")
    last, after = settled(bench)
    assert after - before == last - first
    assert session.used["camera"] > used
    part = "moving transforms"
    if is_taken:
        bench.until(lambda: session.used[part] > 0, what="transforms that are used")
        assert session.too_large[part] == 0
        assert len(bench.node._session.frame_builder.transforms.frames) <= 1001
    else:
        assert session.used[part] == 0
        assert session.too_large[part] == session.unusable[part] > 10
        line = f"expected at most 1000 transforms in 512 KiB in a message on /tf, got {size}"
        assert len([log for log in bench.logs if line in log]) == 1
        bench.diagnostics.clear()
        status = bench.until(lambda: bench.status("calibration", line), what="its line in diagnostics")
        assert status.level == b"\x01"
        assert int(values(bench, "calibration")[f"{part}: too large"]) > 10


def test_while_a_large_cloud_is_decoded_images_parameters_and_diagnostics_go_on(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    bench.await_depth()
    session = bench.node._session
    decode, is_begun, may_end = session.reader._decode, threading.Event(), threading.Event()

    def hold(topic: str, message: Any) -> Any:
        if message.header.frame_id == "large":
            is_begun.set()
            may_end.wait(100)
        return decode(topic, message)

    session.reader._decode = hold
    cloud = bench.cloud([10.0] * CLOUD_POINTS, frame_id="large")
    bench.send_until(is_begun.is_set, lambda: bench.send("radar/points", cloud), what="the cloud")
    bench.diagnostics.clear()
    assert bench.set_parameter("max_wait_s", 0.03) == ""
    bench.await_depth(lambda: (bench.send("camera_info", bench.camera_info()), bench.send("image", bench.image())))
    bench.until(lambda: bench.diagnostics, what="diagnostics")
    assert session.reader.pending(RADAR) > 0
    bench.send_until(
        lambda: session.reader.dropped[RADAR],
        lambda: bench.send("radar/points", cloud),
        what="clouds that are dropped for newer ones",
    )
    may_end.set()
    bench.until(lambda: not session.reader.pending(RADAR), what="the rest of the clouds")
    shown = str(session.reader.dropped[RADAR])
    bench.until(lambda: values(bench, RADAR)["dropped before they were decoded"] == shown, what="their number")
    bench.await_depth()


def test_bytes_that_are_no_message_are_counted_by_topic_beside_good_messages(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    bench.await_depth()
    session, rng = bench.node._session, random.Random(5)
    parts = {"image": "camera", "camera_info": "camera_info", "radar/points": RADAR}
    # Another publisher of each topic, so that numbers tell nothing.
    types = {"image": "Image", "camera_info": "CameraInfo", "radar/points": "PointCloud2"}
    good = {topic: bench._publishers[topic] for topic in parts}
    for topic, name in types.items():
        bench.advertise(topic, f"sensor_msgs/msg/{name}")
    bad = {topic: bench._publishers[topic] for topic in parts}
    bench._publishers.update(good)
    bench.until(lambda: all(publisher.get_subscription_count() for publisher in bad.values()))

    def send() -> None:
        bench.send_pair()
        for publisher in bad.values():
            publisher.publish(b"\x00\x01\x00\x00" + rng.randbytes(rng.randrange(80)))

    bench.send_until(lambda: all(session.undecodable[part] >= 10 for part in parts.values()), send, "10 of each")
    for part, prefix in (("camera", ""), (RADAR, ""), ("calibration", "camera_info: ")):
        bench.until(lambda part=part, prefix=prefix: int(values(bench, part)[f"{prefix}undecodable"]) >= 10)
    assert all(session.undecodable[part] == session.unusable[part] for part in parts.values())
    assert session.used["camera"] > 0
    lines = [line for line in bench.logs if "bytes that are none" in line]
    assert 3 <= len(lines) <= 30
    assert all("ros2 topic info --verbose /" in line for line in lines)
    bench.await_depth()
    bench.diagnostics.clear()
    bench.send_until(lambda: bench.diagnostics and bench.diagnostics[-1]["camera"].level == b"\x00", what="recovery")
