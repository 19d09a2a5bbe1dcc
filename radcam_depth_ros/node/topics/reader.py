"""Reads the serialised messages of inputs: small ones at once, large ones in a thread.

Subscriptions take messages as bytes. So one that is no message of its type is counted, rclpy would pass it over in
silence, and the executor hears services and newer messages while a large one is decoded.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from radcam_depth_ros.bags import MOST_SCAN_BYTES, RADAR_SCAN, RADAR_TYPES, BagError, deserialise, prepare
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.geometry import MAX_LINKS
from radcam_depth_ros.node.topics.inputs import COMPRESSED, TRANSFORM_TYPE, TRANSPORT_TYPES, Input

MOST_TRANSFORM_BYTES = 512 * 1024
"""A message of transforms has no more, nor more than `MAX_LINKS` links."""
_KIB = 1024
_SMALL_BYTES = {
    TRANSPORT_TYPES["raw"]: 8192 * _KIB,
    TRANSPORT_TYPES[COMPRESSED]: 0,  # few bytes may be many pixels
    RADAR_TYPES[0]: 256 * _KIB,
    RADAR_SCAN: 16 * _KIB,  # which is read return by return
    TRANSFORM_TYPE: 16 * _KIB,
}
"""Up to here a message of a type is decoded in some milliseconds; of other types up to the next."""
_SMALL_OTHER_BYTES = 64 * _KIB


class UndecodableError(RadcamDepthError):
    """Bytes that are no message of their topic's type."""


class TooLargeError(RadcamDepthError):
    """A message that is larger than what is read of its type."""


@dataclass(frozen=True)
class Reading:
    """A message that was read.

    Attributes:
        source: Its input.
        message: The message, with ROS's attribute names; None where the bytes are none, or too many.
        content: What `decode` gave; None where it could not be decoded.
        error: Why that is so; None where all is well.
        arrived_ns: When it came, and
        decoded_ns: when it was decoded, on the steady clock.
    """

    source: Input
    message: Any
    content: Any
    error: Exception | None
    arrived_ns: int
    decoded_ns: int


class Reader:
    """Deserialises and decodes messages, and hands them back in the executor's thread, each input's in their order.

    Of an input as many wait as its queue is deep; the oldest is dropped for a newer one. Inputs take turns, so that an
    image waits for one large message of each other input at most.

    Args:
        node: Its executor's thread calls `put`, and is where `on_read` is called.
        inputs: All that are read.
        decode: Called with a topic and a message, in any thread.
        on_read: Called with each message that was read.

    Attributes:
        dropped: How many messages of each part were dropped for newer ones.
    """

    def __init__(
        self,
        node: Node,
        inputs: Iterable[Input],
        decode: Callable[[str, Any], Any],
        on_read: Callable[[Reading], None],
    ) -> None:
        self._node, self._decode, self._on_read = node, decode, on_read
        self.dropped: Counter[str] = Counter()
        self._changed = threading.Condition()
        # By part, the one whose turn it is first; with the input, whose type may change.
        self._waiting: OrderedDict[str, deque[tuple[Input, bytes, int]]] = OrderedDict()
        self._pending: Counter[str] = Counter()  # by part: those that wait, are read, or were read
        self._done: deque[Reading] = deque()
        self._closed = threading.Event()
        self._guard = node.create_guard_condition(self._hand_back)
        self._thread: threading.Thread | None = None
        for name in {source.type_name for source in inputs}:
            prepare(name)

    def pending(self, part: str) -> int:
        """How many messages of a part are on their way."""
        return self._pending[part]

    def put(self, source: Input, raw: bytes, arrived_ns: int) -> None:
        """Takes a serialised message; a small one is read before this returns.

        Args:
            source: Its input.
            raw: CDR bytes.
            arrived_ns: When it came, on the steady clock.
        """
        is_small = len(raw) <= _SMALL_BYTES.get(source.type_name, _SMALL_OTHER_BYTES)
        with self._changed:
            if self._closed.is_set():
                return
            is_next = not self._pending[source.part]
            error = _excess(source, raw)
            if not (is_next and is_small) and error is None:
                self._queue(source, raw, arrived_ns)
                return
        if error is not None:
            self._on_read(Reading(source, None, None, error, arrived_ns, time.monotonic_ns()))
        else:
            self._on_read(self._read(source, raw, arrived_ns))

    def close(self, timeout_s: float | None = None) -> None:
        """Ends the thread, after the message that it reads or `timeout_s`; nothing is handed back any more."""
        with self._changed:
            self._closed.set()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout_s)
        self._node.destroy_guard_condition(self._guard)

    def _queue(self, source: Input, raw: bytes, arrived_ns: int) -> None:
        if source.part not in self._waiting:
            self._waiting[source.part] = deque()
            self._waiting.move_to_end(source.part, last=False)
        queue = self._waiting[source.part]
        if len(queue) >= source.depth:
            queue.popleft()
            self.dropped[source.part] += 1
            self._pending[source.part] -= 1
        queue.append((source, raw, arrived_ns))
        self._pending[source.part] += 1
        if self._thread is None:
            # A daemon, as the network's: a large picture must not keep a process from ending.
            self._thread = threading.Thread(target=self._run, name="radcam_depth reader", daemon=True)
            self._thread.start()
        self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed.is_set() or any(self._waiting.values()))
                if self._closed.is_set():
                    return
                part = next(part for part, queue in self._waiting.items() if queue)
                self._waiting.move_to_end(part)
                source, raw, arrived_ns = self._waiting[part].popleft()
            reading = self._read(source, raw, arrived_ns)
            with self._changed:
                if self._closed.is_set():
                    return
                self._done.append(reading)
                self._guard.trigger()

    def _hand_back(self) -> None:
        while True:
            with self._changed:
                if self._closed.is_set() or not self._done:
                    return
                reading = self._done.popleft()
                self._pending[reading.source.part] -= 1
            self._on_read(reading)

    def _read(self, source: Input, raw: bytes, arrived_ns: int) -> Reading:
        message, content = None, None
        error: Exception | None = None
        try:
            message = deserialise(raw, source.type_name)
            content = self._decode(source.topic, message)
        except BagError as caught:
            error = UndecodableError(
                f"expected messages of {source.type_name} on {source.topic}, got bytes that are none ({caught}); look "
                f"who publishes them: ros2 topic info --verbose {source.topic}"
            )
        except Exception as caught:  # the boundary: who is handed it back tells defects from what users can mend
            error = caught
        return Reading(source, message, content, error, arrived_ns, time.monotonic_ns())


def _excess(source: Input, raw: bytes) -> TooLargeError | None:
    """What is too large about a scan, by its size, or a message of transforms, by its first bytes."""
    if source.type_name == RADAR_SCAN and len(raw) > MOST_SCAN_BYTES:
        return TooLargeError(
            f"expected at most {MOST_SCAN_BYTES // _KIB} KiB in a scan on {source.topic}, got {len(raw) // _KIB} KiB: "
            "it is left out; set a threshold in the driver"
        )
    if source.type_name != TRANSFORM_TYPE:
        return None
    # After four bytes that say how the rest is written comes the number of links.
    links = int.from_bytes(raw[4:8], "little" if raw[1:2] == b"\x01" else "big")
    # A number that its bytes cannot hold is no message at all.
    if len(raw) <= MOST_TRANSFORM_BYTES and (links <= MAX_LINKS or links > len(raw)):
        return None
    return TooLargeError(
        f"expected at most {MAX_LINKS} transforms in {MOST_TRANSFORM_BYTES // _KIB} KiB in a message on "
        f"{source.topic}, got {links} in {len(raw) // _KIB} KiB: it is left out; publish fewer at once, or look who "
        f"else does: ros2 topic info --verbose {source.topic}"
    )
