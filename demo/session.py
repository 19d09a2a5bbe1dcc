"""The live node under way: found, followed frame by frame, given up on when nothing comes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from demo.process import DemoError, NodeProcess
from demo.recorder import Recorder
from radcam_depth_ros.bag_player import CLOCK_PERIOD_S, PlayedMessage, Player
from radcam_depth_ros.bags import header_stamp_ns

START_TIMEOUT_S = 300.0
FRAME_TIMEOUT_S = 60.0
MISSES_ALLOWED = 2


class Session:
    """Decides when the next message may be played, and notes when each image was.

    Attributes:
        sent_s: Stamp of each image that was played, nanoseconds, to its steady time, seconds.
        advance: Called with every image that is played.

    Args:
        process: The node.
        recorder: Of what it publishes.
        image_topic: The images among what is played.
        depth_topic: The depth images among what is recorded.
        waits: Hold the recording back until the depth of the last image is there.
    """

    def __init__(
        self, process: NodeProcess, recorder: Recorder, image_topic: str, depth_topic: str, waits: bool
    ) -> None:
        self._process = process
        self._recorder = recorder
        self._image_topic = image_topic
        self._depth_topic = depth_topic
        self._waits = waits
        self._last_ns: int | None = None
        self._missed_in_a_row = 0
        self.sent_s: dict[int, float] = {}
        self.advance: Callable[[], None] = lambda: None

    def ready(self, message: PlayedMessage) -> bool:
        """Whether a message may be played now."""
        if message.topic != self._image_topic:
            return True
        self._process.check()
        if self._waits and self._last_ns is not None and not self._is_over(self._last_ns):
            return False
        self._last_ns = header_stamp_ns(message.raw)
        self.sent_s[self._last_ns] = time.monotonic()
        self.advance()
        return True

    def finish(self) -> None:
        """Waits for the last depth image."""
        while self._last_ns is not None and not self._is_over(self._last_ns):
            self._process.check()
        if not self._recorder.arrivals_s(self._depth_topic):
            raise DemoError(f"the node gave no depth image at all; its log ends with:\n{self._process.last_lines}")

    def _is_over(self, stamp_ns: int) -> bool:
        """Whether the depth of an image came, or is not to be waited for any longer."""
        if self._recorder.wait_for(stamp_ns, CLOCK_PERIOD_S):
            self._missed_in_a_row = 0
            return True
        if time.monotonic() - self.sent_s[stamp_ns] < FRAME_TIMEOUT_S:
            return False
        self._missed_in_a_row += 1
        if self._missed_in_a_row > MISSES_ALLOWED:
            raise DemoError(
                f"no depth image came for {self._missed_in_a_row} images in a row, {FRAME_TIMEOUT_S:.0f} s each; the "
                f"node's log ends with:\n{self._process.last_lines}"
            )
        return True


class Listener(Protocol):
    """Subscribes to what the node publishes."""

    def unpublished(self) -> tuple[str, ...]:
        """Topics that nobody publishes yet."""


def await_discovery(process: NodeProcess, player: Player, listener: Listener) -> None:
    """Waits until the node listens to all that is played, and publishes all that is listened to."""
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while missing := (*player.unheard(), *listener.unpublished()):
        process.check()
        if problem := process.problem:
            raise DemoError(f"the node cannot start: {problem}")
        if time.monotonic() > deadline_s:
            raise DemoError(
                f"after {START_TIMEOUT_S:.0f} s the node still lacks {', '.join(missing)}; its log ends with:\n"
                f"{process.last_lines}"
            )
        time.sleep(0.05)


@contextlib.contextmanager
def ros_node() -> Iterator[Node]:
    """The ROS node that plays and records."""
    rclpy.init(args=[])
    node = rclpy.create_node("radcam_depth_demo")
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@contextlib.contextmanager
def spinning(node: Node) -> Iterator[None]:
    """Takes a node's messages in a thread of its own."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, name="recording", daemon=True)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join()
