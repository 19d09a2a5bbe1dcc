"""Plays a bag's sensor topics over DDS, with /clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

CLOCK_PERIOD_S = 0.02
MAX_LEAD_NS = 500_000_000
"""So far /clock runs ahead of a message that is held back; then it stands still."""


class PlayedMessage(Protocol):
    """A message of a bag, as the player needs it."""

    topic: str
    log_time_ns: int
    raw: bytes


def message_class(type_name: str) -> Any:
    """The generated class of a type such as `sensor_msgs/msg/Image`."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class Player:
    """Publishes messages as they were recorded, with /clock, in the recording's time or a multiple of it.

    Args:
        node: The ROS node that the publishers belong to.
        topics: Topic to type of what is played.
        rate: Seconds of the recording in one second; at most, where messages are held back.
    """

    def __init__(self, node: Node, topics: Mapping[str, str], rate: float) -> None:
        qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        self._clock = node.create_publisher(Clock, "/clock", qos)
        self._publishers = {
            topic: node.create_publisher(message_class(type_name), topic, qos) for topic, type_name in topics.items()
        }
        self._rate = rate
        self._clock_ns = 0

    def unheard(self) -> tuple[str, ...]:
        """Topics, /clock included, that nobody subscribes to yet."""
        publishers = {**self._publishers, "/clock": self._clock}
        return tuple(topic for topic, publisher in publishers.items() if not publisher.get_subscription_count())

    def play(self, messages: Iterable[PlayedMessage], ready: Callable[[PlayedMessage], bool], tail_s: float) -> None:
        """Plays messages, and lets /clock run on for a while after the last.

        Args:
            messages: By log time; only of the player's topics.
            ready: Asked before each message whether it may be published, again and again until it may; where it says no
                it should have waited a few hundredths of a second. What comes after is delayed as much. Meanwhile
                /clock runs on a little, since the node may wait for time to pass before it can give what is waited for.
            tail_s: Seconds of the recording's time after the last message.
        """
        origin_s, first_ns, last_ns = time.monotonic(), None, 0
        for message in messages:
            last_ns = message.log_time_ns
            first_ns = last_ns if first_ns is None else first_ns
            self._wait_until(last_ns, origin_s, first_ns)
            asked_s = time.monotonic()
            while not ready(message):
                waited_ns = int((time.monotonic() - asked_s) * self._rate * 1e9)
                self._set_clock(last_ns + min(waited_ns, MAX_LEAD_NS))
            origin_s += time.monotonic() - asked_s
            self._set_clock(last_ns)
            self._publishers[message.topic].publish(message.raw)
        if first_ns is not None:
            self._wait_until(last_ns + int(tail_s * 1e9), origin_s, first_ns)

    def _wait_until(self, time_ns: int, origin_s: float, first_ns: int) -> None:
        """Sleeps until a time of the recording, which began with `first_ns` at `origin_s`, with /clock running."""
        due_s = origin_s + (time_ns - first_ns) * 1e-9 / self._rate
        while (left_s := due_s - time.monotonic()) > 0:
            time.sleep(min(left_s, CLOCK_PERIOD_S))
            left_ns = int((due_s - time.monotonic()) * self._rate * 1e9)
            self._set_clock(time_ns - max(left_ns, 0))

    def _set_clock(self, time_ns: int) -> None:
        """Publishes a time on /clock, which never goes back."""
        self._clock_ns = max(self._clock_ns, time_ns)
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(self._clock_ns, 1_000_000_000)
        self._clock.publish(clock)
