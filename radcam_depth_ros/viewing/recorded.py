"""Reads recorded or live depth images in place of a network's output."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Protocol

import numpy as np

from radcam_depth_ros.bags import TopicInfo, header_stamp_ns
from radcam_depth_ros.bags.topics import IMAGE_TYPES
from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.frame import DepthResult, FloatArray, Frame
from radcam_depth_ros.messages import Calibration, decode_depth

_DEPTH, _CAMERA_INFO, _SEMI_DENSE, _CONFIDENCE = (
    OUTPUTS[name].topic for name in ("depth", "depth_camera_info", "semi_dense", "confidence")
)
_JUMP_NS = 1_000_000_000
"""Live stamps that go back further begin anew, as those of a bag that is played in a loop."""


class StoredMessage(Protocol):
    """A message as it was stored or came."""

    @property
    def topic(self) -> str:
        """Topic name."""

    @property
    def log_time_ns(self) -> int:
        """When it came, nanoseconds."""

    @property
    def raw(self) -> bytes:
        """The serialised message (CDR)."""

    @property
    def message(self) -> Any:
        """The message."""


class Source(Protocol):
    """A bag, or live topics."""

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """What there is."""

    def messages(self, topics: Collection[str]) -> Iterator[StoredMessage]:
        """The messages on these topics as they came."""


def find_recorded_depth(reader: Source, namespace: str | None = None) -> str | None:
    """The namespace in which the node's depth is, `/` for its own names; None where there is none.

    Args:
        reader: The bag, or the live topics.
        namespace: The only one that is looked at, such as `/front/`; all by default.
    """
    names = {topic.name for topic in reader.topics if topic.count}
    images = {topic.name for topic in reader.topics if topic.type_name == IMAGE_TYPES[0]}
    namespaces = [name.removesuffix(_DEPTH) for name in names & images if name.endswith(f"/{_DEPTH}")]
    namespaces = [name for name in namespaces if namespace in (None, name)]
    return min((name for name in namespaces if f"{name}{_CAMERA_INFO}" in names), key=len, default=None)


class RecordedDepth:
    """The depth of frame after frame.

    Args:
        reader: The bag, which stays open as long as this is used, or the live topics.
        namespace: Of the node's topics, as `find_recorded_depth` gives it.
        is_live: Stamps may begin anew.
    """

    def __init__(self, reader: Source, namespace: str = "/", *, is_live: bool = False) -> None:
        recorded = {topic.name for topic in reader.topics if topic.count}
        wanted = {namespace + name: name for name in (_DEPTH, _CAMERA_INFO, _SEMI_DENSE, _CONFIDENCE)}
        self._names = {topic: name for topic, name in wanted.items() if topic in recorded}
        self._messages = reader.messages(self._names.keys())
        self._waiting: dict[int, dict[str, Any]] = {}
        self._is_live, self._last_ns = is_live, 0

    def predict(self, frame: Frame) -> DepthResult | None:
        """The depth recorded for a frame, None where there is none; frames in the order of their stamps."""
        if self._is_live and frame.stamp_ns < self._last_ns - _JUMP_NS:
            self._waiting.clear()
        self._last_ns = frame.stamp_ns
        for stamp_ns in [stamp for stamp in self._waiting if stamp < frame.stamp_ns]:
            del self._waiting[stamp_ns]
        # The node publishes one frame after the other: once a later one is complete, this one is not to come.
        while not any(self._is_complete(stamp_ns) for stamp_ns in self._waiting):
            item = next(self._messages, None)
            if item is None:
                break
            stamp_ns = header_stamp_ns(item.raw)
            if self._is_live and stamp_ns < frame.stamp_ns - _JUMP_NS:
                self._waiting = {stamp_ns: {self._names[item.topic]: item}}
                return None
            if stamp_ns >= frame.stamp_ns:
                self._waiting.setdefault(stamp_ns, {})[self._names[item.topic]] = item
        if not self._is_complete(frame.stamp_ns):
            return None
        found = {name: item.message for name, item in self._waiting.pop(frame.stamp_ns).items()}
        camera = Calibration(found[_CAMERA_INFO]).camera
        dense = decode_depth(found[_DEPTH]).depth_m

        def depth_of(name: str) -> FloatArray:
            return decode_depth(found[name]).depth_m if name in found else np.full_like(dense, np.nan)

        semi_dense, confidence = depth_of(_SEMI_DENSE), depth_of(_CONFIDENCE)
        return DepthResult(
            frame.stamp_ns, frame.frame_id, camera, dense, semi_dense, confidence, radar_in_view=len(frame.radar)
        )

    @property
    def topics(self) -> tuple[str, ...]:
        """What it reads."""
        return tuple(self._names)

    def _is_complete(self, stamp_ns: int) -> bool:
        return len(self._waiting.get(stamp_ns, ())) == len(self._names)
