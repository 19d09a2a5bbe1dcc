"""A ROS node that keeps what it is given, and messages as a bag has them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from small_drive import small_messages

from radcam_depth_ros.bags import BagMessage, BagReader, BagWriter, factory


class FakePublisher:
    """Keeps what is published, in one list with all others."""

    def __init__(self, topic: str, published: list[tuple[str, Any]]) -> None:
        self.topic = topic
        self.subscribers = 1
        self._published = published

    def publish(self, message: Any) -> None:
        self._published.append((self.topic, message))

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


@pytest.fixture
def fake_node() -> FakeNode:
    return FakeNode()


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Sequence[BagMessage]:
    """Three frames of the small drive: radar, image, camera_info and exact depth, every 100 ms."""
    path: Path = tmp_path_factory.mktemp("recorded") / "drive.mcap"
    with BagWriter(path) as writer:
        for index in range(3):
            for topic, type_name, message, time_ns in small_messages(factory, index):
                writer.write(topic, message, time_ns, type_name)
    with BagReader(path) as reader:
        return tuple(reader.messages())
