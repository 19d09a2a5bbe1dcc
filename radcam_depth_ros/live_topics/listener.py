"""The topics of the ROS graph, read as those of a bag."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from radcam_depth_ros.bag_player import message_class, ros_node, why_not
from radcam_depth_ros.bags import TopicInfo
from radcam_depth_ros.frame import RadcamDepthError

FoundT = TypeVar("FoundT")
LISTENER_NODE = "radcam_depth_listener"
_QUEUE_DEPTH = 10
_LATCHED_DEPTH = 1000
_STEP_S = 0.05
_WAITING_BYTES = 512_000_000
"""What waits to be read takes no more memory than this; the oldest goes first."""


@dataclass(frozen=True)
class ListenOptions:
    """How long is listened.

    Attributes:
        seconds: From when the topics were found; None without end.
        patience_s: It ends, too, when nothing came for so long of what is waited for.
        discovery_s: Topics are looked for no longer than this.
        settle_s: So long is waited at first, since publishers are not all found at once.
    """

    seconds: float | None = None
    patience_s: float = 10.0
    discovery_s: float = 10.0
    settle_s: float = 1.0

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise RadcamDepthError(f"the seconds to listen must be positive, got {self.seconds:g}")


class Heard:
    """A message as it came; it is deserialised when `message` is first asked for.

    Attributes:
        topic: Topic name.
        type_name: For example `sensor_msgs/msg/Image`.
        log_time_ns: When it came, nanoseconds since 1970 by a clock that never goes back.
        raw: The serialised message (CDR).
    """

    def __init__(self, topic: str, type_name: str, log_time_ns: int, raw: bytes) -> None:
        self.topic, self.type_name, self.log_time_ns, self.raw = topic, type_name, log_time_ns, raw

    @cached_property
    def message(self) -> Any:
        """The message, of rclpy's class."""
        return deserialize_message(self.raw, message_class(self.type_name))


class Listener:
    """Topics of the ROS graph, read as those of a bag; it is spun while something is read or waited for.

    Args:
        node: Hears them; nothing else may spin it.
        executor: Of that node.
        options: How long is listened.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor, options: ListenOptions) -> None:
        self._node, self._executor, self._options = node, executor, options
        self._heard: Counter[str] = Counter()
        self._ends_s = math.inf
        self._stopped = False

    @property
    def is_over(self) -> bool:
        """Whether it was stopped, or its time is over."""
        return self._stopped or time.monotonic() >= self._ends_s

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """What others publish now, of types that are installed here; `count` is of the publishers."""
        found = []
        for name, types in self._node.get_topic_names_and_types():
            publishers = [
                info for info in self._node.get_publishers_info_by_topic(name) if info.node_name != LISTENER_NODE
            ]
            if len(types) != 1 or not publishers or why_not(types[0]):
                continue
            offers = [info.qos_profile for info in publishers]
            found.append(
                TopicInfo(
                    name,
                    types[0],
                    len(publishers),
                    latched=all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers),
                    reliable=all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers),
                )
            )
        return tuple(found)

    def messages(self, topics: Collection[str]) -> Iterator[Heard]:
        """What comes on these topics from now on, until it ends; it asks of each what all of its publishers offer."""
        waiting: deque[Heard] = deque()
        size = 0
        epoch_ns = time.time_ns() - time.monotonic_ns()

        def take(topic: TopicInfo, raw: bytes) -> None:
            nonlocal size
            self._heard[topic.name] += 1
            waiting.append(Heard(topic.name, topic.type_name, epoch_ns + time.monotonic_ns(), raw))
            size += len(raw)
            while size > _WAITING_BYTES:
                size -= len(waiting.popleft().raw)

        def read() -> Iterator[Heard]:
            nonlocal size
            last_s = time.monotonic()
            while not self.is_over:
                if waiting:
                    last_s = time.monotonic()
                    heard = waiting.popleft()
                    size -= len(heard.raw)
                    yield heard
                elif time.monotonic() - last_s > self._options.patience_s:
                    self.stop()
                else:
                    self._executor.spin_once(timeout_sec=_STEP_S)

        for topic in self.topics:
            if topic.name in topics:
                self._subscribe(topic, take)
        return read()

    def stop(self) -> None:
        """Ends all that is read."""
        self._stopped = True

    def find(self, find: Callable[[], FoundT]) -> FoundT:
        """What is found in the graph once it can be; from then on the time runs.

        Args:
            find: Asked again and again, as long as it raises a RadcamDepthError.

        Raises:
            RadcamDepthError: the last one that it raised.
        """
        started_s = time.monotonic()
        while True:
            self._executor.spin_once(timeout_sec=_STEP_S)
            waited_s = time.monotonic() - started_s
            if waited_s < self._options.settle_s and not self._stopped:
                continue
            try:
                found = find()
            except RadcamDepthError:
                if waited_s > self._options.discovery_s or self._stopped:
                    raise
            else:
                if self._options.seconds is not None:
                    self._ends_s = time.monotonic() + self._options.seconds
                return found

    def describe(self, topics: Collection[str]) -> str:
        """How many messages came on some topics, and from how many publishers, for a sentence."""
        return ", ".join(
            f"{name} (publishers: {self._node.count_publishers(name)}, messages: {self._heard[name]})"
            for name in topics
        )

    def _subscribe(self, topic: TopicInfo, take: Callable[[TopicInfo, bytes], None]) -> None:
        qos = QoSProfile(
            depth=_LATCHED_DEPTH if topic.latched else _QUEUE_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
        )
        self._node.create_subscription(message_class(topic.type_name), topic.name, partial(take, topic), qos, raw=True)


@contextmanager
def listener(options: ListenOptions) -> Iterator[Listener]:
    """A listener in a ROS context of its own; Ctrl-C stays Python's."""
    with ros_node(LISTENER_NODE) as node:
        executor = SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        try:
            yield Listener(node, executor, options)
        finally:
            executor.shutdown()
