"""Reads ROS 2 bags: a rosbag2 folder (MCAP or SQLite) or a single .mcap or .db3 file."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import Connection, QosDurability, QosHistory, QosReliability

from radcam_depth_ros.bags.definitions import MessageType
from radcam_depth_ros.bags.errors import BagError, nearest
from radcam_depth_ros.bags.recording import BoundedReader

_STORAGE_SUFFIXES = (".mcap", ".db3")


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag.

    Attributes:
        name: For example `/camera/image_raw`.
        type_name: For example `sensor_msgs/msg/Image`.
        count: Number of messages.
        latched: Whether it was published transient local, as `/tf_static` always is.
        reliable: Whether it was published reliable; True where the bag does not say.
        queue_depth: How many messages its publisher kept; 0 where the bag does not say, or for all of them.
    """

    name: str
    type_name: str
    count: int
    latched: bool = False
    reliable: bool = True
    queue_depth: int = 0


class BagMessage:
    """A message as recorded; it is deserialised when `message` is first asked for.

    Attributes:
        topic: Topic name.
        type_name: For example `sensor_msgs/msg/Image`.
        log_time_ns: When it was recorded, nanoseconds.
        raw: The serialised message (CDR).
        message_type: How `raw` is laid out, for copying it to another bag.
        qos_profiles: The quality of service that its publishers offered, as rosbags gives it.
    """

    def __init__(
        self, connection: Connection, log_time_ns: int, raw: bytes, message_type: MessageType | BagError
    ) -> None:
        self.topic: str = connection.topic
        self.type_name: str = connection.msgtype
        self.log_time_ns = log_time_ns
        self.raw = raw
        self.qos_profiles: tuple[Any, ...] = tuple(connection.ext.offered_qos_profiles)
        self._message_type = message_type

    @cached_property
    def message_type(self) -> MessageType:
        """How `raw` is laid out; BagError where nobody defines it."""
        # Without a known layout (an old SQLite bag with a vendor's type) only this topic is of no use, not the bag.
        if isinstance(self._message_type, BagError):
            raise BagError(*self._message_type.args)
        return self._message_type

    @cached_property
    def message(self) -> Any:
        """The message, with ROS's attribute names; arrays are read-only views. BagError where it is damaged."""
        return self.message_type.deserialise(self.raw, self.topic)


class BagReader:
    """A bag opened for reading; a context manager.

    Args:
        path: A rosbag2 folder with its metadata.yaml, or a single .mcap or .db3 file.

    Attributes:
        path: Where the bag is.
        topics: What it holds, sorted by name.

    Raises:
        BagError: for a path that is missing, no bag, or a bag that is truncated or damaged.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        _check_is_bag(self.path)
        self._types: dict[str, MessageType | BagError] = {}
        self._reader = BoundedReader(self.path)
        try:
            self._reader.open()
            self._connections: list[Connection] = list(self._reader.connections)
            self._check_metadata()
            self.topics: tuple[TopicInfo, ...] = self._list_topics()
        except Exception as error:  # a damaged file makes the parser raise nearly anything
            self.close()
            raise self._unreadable(error) from error

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the bag; again is harmless."""
        if self._reader.is_open:
            self._reader.close()

    @property
    def start_ns(self) -> int:
        """Log time of the first message, nanoseconds; 0 for an empty bag."""
        return int(self._reader.start_time) if self._reader.message_count else 0

    @property
    def duration_ns(self) -> int:
        """From the first to the last message, nanoseconds."""
        return max(0, int(self._reader.duration) - 1)  # rosbags counts the end as one past the last message

    def count(self, topics: Collection[str] | None = None) -> int:
        """Number of messages on these topics, by default on all."""
        self._check_topics(topics)
        return sum(topic.count for topic in self.topics if topics is None or topic.name in topics)

    def messages(
        self, topics: Collection[str] | None = None, *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """The messages in the order of their log times.

        Args:
            topics: Names of the topics to read; all by default.
            start_ns: The first log time to read, nanoseconds.
            stop_ns: The first log time after that, nanoseconds.

        Raises:
            BagError: for a topic that the bag lacks, and where the bag turns out to be damaged.
        """
        self._check_topics(topics)
        chosen = [connection for connection in self._connections if topics is None or connection.topic in topics]
        return self._read(chosen, start_ns, stop_ns)

    def _read(self, connections: list[Connection], start_ns: int | None, stop_ns: int | None) -> Iterator[BagMessage]:
        if not connections:  # to rosbags none means all
            return
        stored = self._reader.messages(connections=connections, start=start_ns, stop=stop_ns)
        while True:
            try:
                item = next(stored, None)
                if item is None:
                    return
                connection, log_time_ns, raw = item
                if not 0 <= log_time_ns < 1 << 63:
                    raise ValueError(f"a message was received at {log_time_ns} ns")
                content = bytes(memoryview(raw))  # SQLite may hold a text or a number in place of bytes
            except Exception as error:  # a damaged file makes the parser raise nearly anything
                raise self._unreadable(error) from error
            yield BagMessage(connection, log_time_ns, content, self._type_of(connection))

    def _type_of(self, connection: Connection) -> MessageType | BagError:
        name = connection.msgtype
        if name not in self._types:
            try:
                self._types[name] = MessageType.recorded(name, connection.msgdef)
            except BagError as error:
                self._types[name] = error
        return self._types[name]

    def _check_metadata(self) -> None:
        """Raises ValueError where names are no texts, or counts and times no numbers."""
        values = {
            str: [text for connection in self._connections for text in (connection.topic, connection.msgtype)],
            int: [
                *(self._reader.message_count, self._reader.start_time, self._reader.duration),
                *(connection.msgcount for connection in self._connections),
            ],
        }
        for kind, found in values.items():
            for value in found:
                if not isinstance(value, kind):
                    raise ValueError(f"its metadata has {str(value)[:80]!r} where {kind.__name__} is expected")

    def _list_topics(self) -> tuple[TopicInfo, ...]:
        # Two publishers of one topic may be two connections.
        groups: dict[tuple[str, str], list[Connection]] = {}
        for connection in self._connections:
            groups.setdefault((connection.topic, connection.msgtype), []).append(connection)
        return tuple(_topic_info(*key, groups[key]) for key in sorted(groups))

    def _check_topics(self, topics: Collection[str] | None) -> None:
        known = {topic.name for topic in self.topics}
        for name in topics or ():
            if name not in known:
                raise BagError(f"the bag {self.path} has no topic {name}; it has {nearest(name, known)}")

    def _unreadable(self, error: Exception) -> BagError:
        if isinstance(error, BagError):
            return BagError(f"the bag {self.path} cannot be read: {error}")
        reason = str(error).rstrip(".") or type(error).__name__
        return BagError(
            f"the bag {self.path} is truncated, damaged or no ROS 2 bag ({reason}); copy or record it again, "
            "or repair an interrupted recording with `mcap recover` or `ros2 bag reindex`"
        )


def _topic_info(name: str, type_name: str, connections: list[Connection]) -> TopicInfo:
    profiles = [profile for connection in connections for profile in connection.ext.offered_qos_profiles]
    return TopicInfo(
        name,
        type_name,
        count=sum(connection.msgcount for connection in connections),
        latched=name == "/tf_static"
        or any(profile.durability == QosDurability.TRANSIENT_LOCAL for profile in profiles),
        reliable=not profiles or any(profile.reliability != QosReliability.BEST_EFFORT for profile in profiles),
        queue_depth=max(
            (int(profile.depth) for profile in profiles if profile.history == QosHistory.KEEP_LAST), default=0
        ),
    )


def _check_is_bag(path: Path) -> None:
    if not path.exists():
        raise BagError(f"there is no bag at {path}; give a rosbag2 folder or an .mcap file")
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return
        files = sorted(file for file in path.iterdir() if file.suffix in _STORAGE_SUFFIXES)
        advice = f"give the file {files[0]} itself" if files else "give a rosbag2 folder or an .mcap file"
        raise BagError(f"the folder {path} is no rosbag2 bag, it has no metadata.yaml; {advice}")
    if path.suffix == ".bag":
        raise BagError(f"{path} is a ROS 1 bag; convert it with `rosbags-convert --src {path} --dst FOLDER`")
    if path.suffix not in _STORAGE_SUFFIXES:
        raise BagError(f"{path} is no bag; expected a rosbag2 folder, an .mcap or a .db3 file")
