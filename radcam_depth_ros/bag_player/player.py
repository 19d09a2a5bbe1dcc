"""Publishes a bag's messages over DDS in the recording's time, with /clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

CLOCK_TOPIC = "/clock"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
CLOCK_PERIOD_S = 0.02
MAX_LEAD_NS = 500_000_000
"""So far /clock runs ahead of a message that is held back; then it stands still."""


class PlayedMessage(Protocol):
    """A message of a bag, as the player needs it."""

    topic: str
    log_time_ns: int
    raw: bytes


@dataclass(frozen=True)
class PlayedTopic:
    """A topic that is published.

    Attributes:
        name: For example `/camera/image_raw`.
        type_name: For example `sensor_msgs/msg/Image`.
        reliable: What is lost on the way is sent again, for whoever asks for it.
        latched: Late subscribers get the last messages as well, as of `/tf_static`.
        queue_depth: So many messages are kept for either.
    """

    name: str
    type_name: str
    reliable: bool = True
    latched: bool = False
    queue_depth: int = 5

    @property
    def qos(self) -> QoSProfile:
        """The quality of service that the publisher offers."""
        return QoSProfile(
            depth=self.queue_depth,
            reliability=ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE,
        )


def message_class(type_name: str) -> Any:
    """The generated class of a type such as `sensor_msgs/msg/Image`.

    Raises:
        ImportError: when its package is not installed.
        AttributeError: when that package has no such message.
    """
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def always(_: PlayedMessage) -> bool:
    """Holds no message back."""
    return True


class Player:
    """Publishes messages as they were recorded, in the recording's time or a multiple of it.

    Args:
        node: The ROS node that the publishers belong to.
        topics: What is played.
        rate: Seconds of the recording in one second; at most, where messages are held back.
        clock: Publish the recording's time on /clock.
    """

    def __init__(self, node: Node, topics: Iterable[PlayedTopic], rate: float, *, clock: bool = True) -> None:
        self._publishers = {
            topic.name: node.create_publisher(message_class(topic.type_name), topic.name, topic.qos) for topic in topics
        }
        self._time: Any = message_class(CLOCK_TYPE) if clock else None
        self._clock = (
            node.create_publisher(self._time, CLOCK_TOPIC, PlayedTopic(CLOCK_TOPIC, CLOCK_TYPE).qos) if clock else None
        )
        self._rate = rate
        self._clock_ns = 0

    def unheard(self) -> tuple[str, ...]:
        """Topics, /clock included, that nobody subscribes to yet."""
        publishers = {**self._publishers, **({CLOCK_TOPIC: self._clock} if self._clock else {})}
        return tuple(topic for topic, publisher in publishers.items() if not publisher.get_subscription_count())

    def play(
        self,
        messages: Iterable[PlayedMessage],
        ready: Callable[[PlayedMessage], bool] = always,
        tail_s: float = 0.0,
        *,
        start_ns: int | None = None,
        played: Callable[[int], None] = lambda _: None,
    ) -> None:
        """Plays messages, and lets /clock run on for a while after the last.

        Args:
            messages: By log time; only of the player's topics.
            ready: Asked before each message whether it may be published, again and again until it may; where it says no
                it should have waited a few hundredths of a second. What comes after is delayed as much. Meanwhile
                /clock runs on a little, since the node may wait for time to pass before it can give what is waited for.
            tail_s: Seconds of the recording's time after the last message.
            start_ns: Time of the recording at which it begins; what is older is published at once, such as latched
                messages. By default the first message's.
            played: Called with the time of each message that was published.
        """
        self._clock_ns = 0  # a second round begins where the first did
        origin_s, last_ns = time.monotonic(), start_ns
        for message in messages:
            if start_ns is None:
                start_ns = message.log_time_ns
            last_ns = max(start_ns, message.log_time_ns)
            self._wait_until(last_ns, origin_s, start_ns)
            asked_s = time.monotonic()
            while not ready(message):
                waited_ns = int((time.monotonic() - asked_s) * self._rate * 1e9)
                self._set_clock(last_ns + min(waited_ns, MAX_LEAD_NS))
            origin_s += time.monotonic() - asked_s
            self._set_clock(last_ns)
            self._publishers[message.topic].publish(message.raw)
            played(last_ns)
        if start_ns is not None and last_ns is not None:
            self._wait_until(last_ns + int(tail_s * 1e9), origin_s, start_ns)

    def finish(self, timeout_s: float = 1.0) -> None:
        """Waits until everybody who asked for reliable messages has them, each topic's no longer than `timeout_s`."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=timeout_s))

    def _wait_until(self, time_ns: int, origin_s: float, first_ns: int) -> None:
        """Sleeps until a time of the recording, which began with `first_ns` at `origin_s`, with /clock running."""
        due_s = origin_s + (time_ns - first_ns) * 1e-9 / self._rate
        while (left_s := due_s - time.monotonic()) > 0:
            time.sleep(min(left_s, CLOCK_PERIOD_S))
            left_ns = int((due_s - time.monotonic()) * self._rate * 1e9)
            self._set_clock(time_ns - max(left_ns, 0))

    def _set_clock(self, time_ns: int) -> None:
        """Publishes a time on /clock, which never goes back."""
        if self._clock is None:
            return
        self._clock_ns = max(self._clock_ns, time_ns)
        clock = self._time()
        clock.clock.sec, clock.clock.nanosec = divmod(self._clock_ns, 1_000_000_000)
        self._clock.publish(clock)
