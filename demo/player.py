"""Plays a bag's sensor topics over DDS, with /clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
CLOCK_PERIOD_S = 0.02


class PlayedMessage(Protocol):
    """A message of a bag, as the player needs it."""

    @property
    def topic(self) -> str:
        """Where it was recorded."""

    @property
    def type_name(self) -> str:
        """Such as `sensor_msgs/msg/Image`."""

    @property
    def log_time_ns(self) -> int:
        """When it was recorded, nanoseconds."""

    @property
    def raw(self) -> bytes:
        """Serialised (CDR)."""


def in_playing_order(messages: Iterable[PlayedMessage]) -> Iterator[PlayedMessage]:
    """Messages by log time, a camera_info before the image of the same time.

    Drivers publish both at once, and a bag may have them in either order.
    """
    same_time: list[PlayedMessage] = []
    for message in messages:
        if same_time and message.log_time_ns != same_time[0].log_time_ns:
            yield from sorted(same_time, key=_is_not_camera_info)
            same_time.clear()
        same_time.append(message)
    yield from sorted(same_time, key=_is_not_camera_info)


def _is_not_camera_info(message: PlayedMessage) -> bool:
    return message.type_name != CAMERA_INFO


def message_class(type_name: str) -> Any:
    """The generated class of a type such as `sensor_msgs/msg/Image`."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class Player:
    """Publishes messages as they were recorded, with /clock, in the recording's time or a multiple of it.

    Args:
        node: The ROS node that the publishers belong to.
        topics: Topic to type of what is played.
        rate: Seconds of the recording in one second; at most, where `before` of `play` waits.
    """

    def __init__(self, node: Node, topics: Mapping[str, str], rate: float) -> None:
        qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)
        self._clock = node.create_publisher(Clock, "/clock", qos)
        self._publishers = {
            topic: node.create_publisher(message_class(type_name), topic, qos) for topic, type_name in topics.items()
        }
        self._rate = rate

    def unheard(self) -> tuple[str, ...]:
        """Topics, /clock included, that nobody subscribes to yet."""
        publishers = {**self._publishers, "/clock": self._clock}
        return tuple(topic for topic, publisher in publishers.items() if not publisher.get_subscription_count())

    def publish(self, message: PlayedMessage) -> None:
        """Publishes one message at once, its log time on /clock before it."""
        self.set_clock(message.log_time_ns)
        self._publishers[message.topic].publish(bytes(message.raw))

    def set_clock(self, time_ns: int) -> None:
        """Publishes a time on /clock."""
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(time_ns, 1_000_000_000)
        self._clock.publish(clock)

    def play(
        self, messages: Iterable[PlayedMessage], held: Collection[str], before: Callable[[PlayedMessage], None]
    ) -> None:
        """Plays messages in playing order.

        Args:
            messages: By log time; only of the player's topics.
            held: Topics of which `before` is called with each message before it is published, with /clock at its time;
                /clock stands still until it returns.
            before: May wait for whatever has to have happened.
        """
        time_ns: int | None = None
        for message in in_playing_order(messages):
            if time_ns is not None:
                self._pass_time(time_ns, message.log_time_ns)
            time_ns = message.log_time_ns
            if message.topic in held:
                self.set_clock(time_ns)
                before(message)
            self.publish(message)

    def _pass_time(self, start_ns: int, stop_ns: int) -> None:
        """Sleeps from one time of the recording to another, with /clock running."""
        began_s = time.monotonic()
        while (left_s := (stop_ns - start_ns) * 1e-9 / self._rate - (time.monotonic() - began_s)) > 0:
            time.sleep(min(left_s, CLOCK_PERIOD_S))
            passed_ns = int((time.monotonic() - began_s) * self._rate * 1e9)
            self.set_clock(min(start_ns + passed_ns, stop_ns))
