"""Writes ROS 2 bags as MCAP, whole or not at all."""

from __future__ import annotations

import re
import struct
from collections.abc import Collection
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import TypesysError

from radcam_depth_ros.bags.definitions import MessageType
from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.reader import BagMessage
from radcam_depth_ros.bags.storage import McapBagWriter, bag_metadata
from radcam_depth_ros.files import partial_folder, sync

_FOREVER = QosTime(9223372036, 854775807)  # RMW_DURATION_INFINITE
_LATCHED = Qos(
    history=QosHistory.KEEP_LAST,
    depth=100,  # every static transform broadcaster sends one message, and a late subscriber needs them all
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_FOREVER,
    lifespan=_FOREVER,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_FOREVER,
    avoid_ros_namespace_conventions=False,
)


OWN = ("written_by", "radcam_depth_ros")
"""Custom data of all bags that are written here."""


def is_own(path: Path) -> bool:
    """Whether a bag was written by `BagWriter`, so that it can be made again; False for what cannot be read.

    A folder must hold nothing else: whoever put notes or a recording beside the bag still wants them.
    """
    try:
        if path.is_dir():
            others = [file for file in path.iterdir() if file.name != "metadata.yaml"]
            if not all(file.suffix == ".mcap" and file.is_file() and is_own(file) for file in others):
                return False
        text = (path / "metadata.yaml").read_bytes() if path.is_dir() else bag_metadata(path)
    except (OSError, ValueError, struct.error):
        return False
    return re.search(rb"^\s*%b: %b\s*$" % (OWN[0].encode(), OWN[1].encode()), text, re.MULTILINE) is not None


class BagWriter:
    """A bag to write into, inside a `with` block: complete after it, gone after an exception.

    It is written beside its place under a temporary name and renamed at the end of the block.

    Args:
        path: With the suffix .mcap a single file; else a rosbag2 folder with metadata.yaml.
        overwrite: Replace a bag that is already there.
        latched: Topics that `ros2 bag play` shall publish reliable and transient local.
        compress: Compress the chunks of the file (zstd), which every MCAP reader undoes.

    Raises:
        BagError: when the path is taken, or cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        overwrite: bool = False,
        latched: Collection[str] = ("/tf_static",),
        compress: bool = True,
    ) -> None:
        self.path = Path(path)
        self._latched = frozenset(latched)
        self._compress = compress
        self._connections: dict[tuple[str, str], Connection] = {}
        self._writer: Any = None
        self._open = ExitStack()
        self._overwrite = overwrite
        self._check_free()

    def __enter__(self) -> BagWriter:
        name = self.path.stem if self._is_file else self.path.name  # what the file inside the folder is called
        with ExitStack() as stack:
            try:
                folder = stack.enter_context(partial_folder(self.path))
                writer = McapBagWriter(
                    folder / name, version=McapBagWriter.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
                )
                if self._compress:
                    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
                writer.set_custom_data(*OWN)
                writer.open()
            except OSError as error:
                raise BagError(f"cannot write a bag at {self.path}: {error}; choose another place") from error
            stack.callback(_close, writer)
            self._writer, self._open = writer, stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        writer, self._writer = self._writer, None
        with self._open:
            try:
                if kind is None:
                    writer.close()
                    self._put_in_place(writer.path)
            except OSError as failure:
                raise BagError(
                    f"cannot finish the bag {self.path}: {failure}; free some space or choose another place"
                ) from failure

    def write(self, topic: str, message: object, log_time_ns: int, type_name: str | None = None) -> None:
        """Serialises and writes a message.

        Args:
            topic: Topic name.
            message: A message made by `bags.factory` or read from a bag.
            log_time_ns: When it counts as received, nanoseconds since the epoch; sets the time of replay.
            type_name: For example `sensor_msgs/msg/Image`; by default what the message says.

        Raises:
            BagError: for a message that does not fit its type.
        """
        name = type_name or getattr(message, "__msgtype__", None)
        if not isinstance(name, str):
            raise BagError(
                f"the message for {topic} does not say its type; give type_name, or build it with bags.factory"
            )
        message_type = MessageType.jazzy(name)
        self._append(topic, message_type, message_type.serialise(message, topic), log_time_ns)

    def write_raw(self, topic: str, raw: bytes | memoryview, log_time_ns: int, type_name: str) -> None:
        """Writes a message of a ROS 2 Jazzy type that is already serialised (CDR)."""
        self._append(topic, MessageType.jazzy(type_name), raw, log_time_ns)

    def copy(self, message: BagMessage, topic: str | None = None) -> None:
        """Writes a message of another bag as it is, with its type and quality of service; `topic` renames it."""
        self._append(
            topic or message.topic, message.message_type, message.raw, message.log_time_ns, message.qos_profiles
        )

    @property
    def _is_file(self) -> bool:
        return self.path.suffix == ".mcap"

    def _append(
        self,
        topic: str,
        message_type: MessageType,
        raw: bytes | memoryview,
        log_time_ns: int,
        qos_profiles: tuple[Any, ...] = (),
    ) -> None:
        if self._writer is None:
            raise BagError(f"the bag {self.path} is not open for writing; write inside its `with` block")
        key = (topic, message_type.name)
        try:
            if key not in self._connections:
                self._connections[key] = self._writer.add_connection(
                    topic,
                    message_type.name,
                    typestore=message_type.typestore,
                    offered_qos_profiles=(_LATCHED,) if topic in self._latched else qos_profiles,
                )
            self._writer.write(self._connections[key], log_time_ns, raw)
        except OSError as error:
            raise BagError(f"cannot write to the bag {self.path}: {error}; free some space") from error
        except TypesysError as error:
            raise BagError(
                f"the definition of {message_type.name}, the type of {topic}, is not whole: {error} Leave the topic "
                "out of what is copied"
            ) from None

    def _check_free(self) -> None:
        if not self.path.name:
            raise BagError(f"{self.path} cannot be a bag; give the name of a new folder or .mcap file")
        if not self.path.exists():
            return
        if not self._overwrite:
            raise BagError(f"{self.path} exists already; choose another name, remove it, or ask to overwrite it")
        # A mistyped path must not cost somebody a folder of other things, and no option a recording.
        if self.path.is_dir() == self._is_file or not is_own(self.path):
            raise BagError(
                f"{self.path} is no bag that radcam-depth wrote, or has other files in it, so it is not overwritten; "
                "remove it, or choose another name"
            )

    def _put_in_place(self, written: Path) -> None:
        self._check_free()  # somebody may have been quicker
        source = next(written.glob("*.mcap")) if self._is_file else written
        for file in written.iterdir():
            sync(file)
        replaced = written.parent / "replaced"  # goes with the temporary folder
        if self.path.is_dir():  # a folder cannot take the place of another in one step
            self.path.rename(replaced)
        try:
            source.replace(self.path)
        except BaseException:
            if replaced.exists():
                replaced.rename(self.path)
            raise
        sync(self.path.parent)


def _close(writer: Any) -> None:
    """Closes the file of a bag that is not finished; after the writer's own close there is nothing to do."""
    with suppress(OSError):  # on a full disk what is left in its buffer has no room either
        writer.abort()
