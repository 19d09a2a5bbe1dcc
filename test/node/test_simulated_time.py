"""With `use_sim_time` the node goes by `/clock`: waiting, standing still and looping with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from radcam_depth_ros.node.topics.factory import build_message

OK, WARN = b"\x00", b"\x01"
HOUR_NS = 3600 * 1_000_000_000


def test_an_image_waits_for_its_sweep_by_the_clock_of_the_bag(start: Callable[..., Any]) -> None:
    bench = start(use_sim_time=True, max_wait_s=1.0)
    bench.advertise("/clock", "rosgraph_msgs/msg/Clock")
    bench.connect("radar/points")

    def tell(seconds: int) -> None:
        time = build_message("builtin_interfaces/msg/Time", sec=seconds, nanosec=0)
        bench.send("/clock", build_message("rosgraph_msgs/msg/Clock", clock=time))

    def is_told(seconds: int) -> Callable[[], bool]:
        return lambda: bool(bench.node.get_clock().now().nanoseconds == seconds * 1_000_000_000)

    def images() -> int:
        return int(bench.node._session.frame_builder.counts.images)

    tell(100)
    bench.until(is_told(100), what="the clock")
    bench.send_until(lambda: images() >= 5, what="images")
    assert not bench.depth  # no sweep came, and the bag stands still

    tell(102)
    bench.until(lambda: bench.depth, what="depth of images that waited long enough")
    bench.diagnostics.clear()
    bench.until(lambda: bench.diagnostics)

    tell(50)  # the bag starts anew
    bench.until(is_told(50), what="the clock")
    bench.depth.clear()
    count = images()
    bench.send_until(lambda: images() >= count + 3, what="images")
    assert not bench.depth
    tell(52)
    bench.until(lambda: bench.depth, what="depth after the jump")


def test_a_clock_that_leaps_an_hour_ahead_and_back_is_named_and_depth_goes_on(start: Callable[..., Any]) -> None:
    bench = start(use_sim_time=True)
    bench.advertise("/clock", "rosgraph_msgs/msg/Clock")
    bench.connect()

    def send() -> None:
        seconds, nanoseconds = divmod(bench.now_ns, 1_000_000_000)
        time = build_message("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        bench.send("/clock", build_message("rosgraph_msgs/msg/Clock", clock=time))
        bench.send_pair()

    def goes_on(since_ns: int) -> bool:
        stamps = [message.header.stamp for message in bench.depth]
        return any(since_ns < stamp.sec * 1_000_000_000 + stamp.nanosec <= bench.now_ns for stamp in stamps)

    def is_healthy() -> bool:
        return bool(bench.diagnostics[-1]["health"].level == OK)

    bench.send_until(is_healthy, send, what="health")
    for leap_ns, words in ((HOUR_NS, "/clock to run on, it leapt 3600 s ahead"), (-HOUR_NS, "jumped back")):
        bench.depth.clear()
        bench.now_ns += leap_ns
        since_ns = bench.now_ns
        bench.diagnostics.clear()
        status = bench.send_until(lambda words=words: bench.status("pairing", words), send, what=words)
        assert status.level == WARN
        bench.send_until(lambda since_ns=since_ns: goes_on(since_ns), send, what="depth after the leap")
        bench.send_until(is_healthy, send, what="health after the leap")
    assert {value.key: value.value for value in bench.diagnostics[-1]["pairing"].values}["pairing: problems"] == "2"
