"""A ROS node that keeps what it is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class FakePublisher:
    """Keeps what is published, in one list with all others."""

    def __init__(self, topic: str, published: list[tuple[str, Any]]) -> None:
        self.topic = topic
        self.subscribers = 1
        self._published = published

    def publish(self, message: Any) -> None:
        self._published.append((self.topic, message))

    def wait_for_all_acked(self, timeout: Any) -> bool:
        return True

    def get_subscription_count(self) -> int:
        return self.subscribers


class FakeNode:
    """In place of rclpy's."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.publishers: dict[str, FakePublisher] = {}
        self.callbacks: dict[str, Callable[[bytes], None]] = {}
        self.remote_publishers: dict[str, int] = {}

    def create_publisher(self, type_: Any, topic: str, qos: Any) -> FakePublisher:
        self.publishers[topic] = FakePublisher(topic, self.published)
        return self.publishers[topic]

    def create_subscription(
        self, type_: Any, topic: str, callback: Callable[[bytes], None], qos: Any, *, raw: bool
    ) -> None:
        assert raw
        self.callbacks[topic] = callback

    def count_publishers(self, topic: str) -> int:
        return self.remote_publishers.get(topic, 0)
