"""Records what the node publishes, and when it came."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import TracebackType

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from radcam_depth_ros.bag_player import message_class
from radcam_depth_ros.bags import BagWriter, header_stamp_ns


class Recorder:
    """Writes topics to a bag as they come, logged at the stamp in their header.

    A context manager: it subscribes when it is entered, and the bag appears under its name when it is left without an
    exception. Messages come in on the executor's thread, which must have ended by then.

    Args:
        node: The ROS node that the subscriptions belong to.
        outputs: Topic to type of what comes once an image, with the image's stamp.
        others: Topic to type of what is recorded besides; each type begins with a std_msgs/Header.
        path: The bag to write; an old one is replaced.
    """

    def __init__(self, node: Node, outputs: Mapping[str, str], others: Mapping[str, str], path: Path) -> None:
        self._outputs = frozenset(outputs)
        self._topics = {**outputs, **others}
        self._node = node
        self._writer = BagWriter(path, overwrite=True)
        self._arrived = threading.Condition()
        self._arrivals_s: dict[int, dict[str, float]] = {}

    def __enter__(self) -> Recorder:
        self._writer.__enter__()
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        for topic, type_name in self._topics.items():
            self._node.create_subscription(
                message_class(type_name), topic, partial(self._record, topic, type_name), qos, raw=True
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.__exit__(kind, error, trace)

    def unpublished(self) -> tuple[str, ...]:
        """Topics that nobody publishes yet."""
        return tuple(topic for topic in self._topics if not self._node.count_publishers(topic))

    def arrivals_s(self, topic: str) -> dict[int, float]:
        """Stamps, nanoseconds, of what came on an output topic, to the steady time of its arrival, seconds."""
        with self._arrived:
            return {stamp: times[topic] for stamp, times in self._arrivals_s.items() if topic in times}

    def wait_for(self, stamp_ns: int, timeout_s: float) -> bool:
        """Waits until all outputs of a stamp are there; False when they aren't after `timeout_s`."""
        with self._arrived:
            return self._arrived.wait_for(lambda: self._outputs <= self._arrivals_s.get(stamp_ns, {}).keys(), timeout_s)

    def _record(self, topic: str, type_name: str, raw: bytes) -> None:
        now_s = time.monotonic()
        stamp_ns = header_stamp_ns(raw)
        self._writer.write_raw(topic, raw, stamp_ns, type_name)
        if topic in self._outputs:
            with self._arrived:
                self._arrivals_s.setdefault(stamp_ns, {})[topic] = now_s
                self._arrived.notify_all()
