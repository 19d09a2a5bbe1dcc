"""Records what the node publishes, and when each depth image came."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from demo.player import message_class
from radcam_depth_ros.bags import BagWriter


def header_stamp_ns(raw: bytes) -> int:
    """The stamp of a serialised (CDR) message that begins with a std_msgs/Header, nanoseconds."""
    byte_order = "<" if raw[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{byte_order}iI", raw, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


class Recorder:
    """Writes topics to a bag as they come, logged at the stamp in their header.

    The bag appears under its name only when the recorder is left without an exception. Messages come in on the
    executor's thread; the other methods may be called from any.

    Args:
        node: The ROS node that the subscriptions belong to.
        topics: Topic to type of what is recorded; each type begins with a std_msgs/Header.
        depth_topic: The one of them whose arrivals are waited for.
        path: The bag to write.
    """

    def __init__(self, node: Node, topics: Mapping[str, str], depth_topic: str, path: Path) -> None:
        self._node = node
        self._topics = dict(topics)
        self._depth_topic = depth_topic
        self._writer = BagWriter(path)
        self._arrived = threading.Condition()
        self._arrivals_s: dict[int, float] = {}

    def __enter__(self) -> Recorder:
        self._writer.__enter__()
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._subscriptions = [
            self._node.create_subscription(
                message_class(type_name), topic, lambda raw, topic=topic: self._record(topic, bytes(raw)), qos, raw=True
            )
            for topic, type_name in self._topics.items()
        ]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        with self._arrived:
            self._writer.__exit__(kind, error, traceback)

    def unpublished(self) -> tuple[str, ...]:
        """Topics that nobody publishes yet."""
        return tuple(topic for topic in self._topics if not self._node.count_publishers(topic))

    @property
    def arrivals_s(self) -> dict[int, float]:
        """Stamp of each depth image that came, nanoseconds, to the steady time of its arrival, seconds."""
        with self._arrived:
            return dict(self._arrivals_s)

    def wait_for_depth(self, stamp_ns: int, timeout_s: float) -> bool:
        """Waits until the depth image of a stamp is there; False when it isn't after `timeout_s`."""
        with self._arrived:
            return self._arrived.wait_for(lambda: stamp_ns in self._arrivals_s, timeout_s)

    def _record(self, topic: str, raw: bytes) -> None:
        now_s = time.monotonic()
        stamp_ns = header_stamp_ns(raw)
        with self._arrived:
            self._writer.write_raw(topic, raw, stamp_ns, self._topics[topic])
            if topic == self._depth_topic:
                self._arrivals_s[stamp_ns] = now_s
                self._arrived.notify_all()
