"""Writes MCAP files without copies of large messages.

rosbags copies a message four times on its way to the file: into a record, a chunk, the chunk's record and the buffer of
the file. For depth images this costs more than all steps before it except the network.
"""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

_LARGE_BYTES = 1 << 20  # at which rosbags closes a chunk
# Opcodes and layouts of the MCAP specification, little endian.
_CHUNK = struct.Struct("<BQQQQIIQ")  # 0x06, length, first and last time, size, checksum, no compression, size
_MESSAGE = struct.Struct("<BQHIQQ")  # 0x05, length, channel, sequence, log time, publish time
_MESSAGE_INDEX = struct.Struct("<BQHIQQ")  # 0x07, length, channel, bytes of the one entry, its time, its offset
_CHUNK_INDEX = struct.Struct("<QQQQIHQQIQQ")  # first and last time, start, length, one offset, index length, sizes
_LENGTH = 9  # of an opcode and a length, which a record's length does not count


class LargeMessageStorage(McapWriter):  # type: ignore[misc]  # rosbags is read without types
    """rosbags' MCAP file, with a chunk of its own for each large message where chunks are not compressed."""

    def write(self, connection: Any, timestamp: int, data: bytes | memoryview) -> None:
        """Writes a serialised message.

        Args:
            connection: The topic's.
            timestamp: Nanoseconds.
            data: The message.
        """
        if self.compression or len(data) < _LARGE_BYTES:
            super().write(connection, timestamp, data)
            return
        if self.chunk.bio.tell():  # holds the channel, where this is its first message
            self.close_chunk()
        self.message_start_time: int = min(timestamp, self.message_start_time)
        self.message_end_time: int = max(timestamp, self.message_end_time)
        self.channel_stats[connection.id] += 1
        times, size = (timestamp, timestamp), _MESSAGE.size + len(data)
        start = self.bio.tell()
        self.bio.write(_CHUNK.pack(0x06, _CHUNK.size - _LENGTH + size, *times, size, 0, 0, size))
        self.bio.write(_MESSAGE.pack(0x05, size - _LENGTH, connection.id, 0, *times))
        self.bio.write(data)
        end = self.bio.tell()
        self.bio.write(_MESSAGE_INDEX.pack(0x07, _MESSAGE_INDEX.size - _LENGTH, connection.id, 16, timestamp, 0))
        index = BytesIO()
        index.write(
            _CHUNK_INDEX.pack(*times, start, end - start, 10, connection.id, end, _MESSAGE_INDEX.size, 0, size, size)
        )
        self.chunks.append(index)


class McapBagWriter(Writer):  # type: ignore[misc]  # as above
    """rosbags' writer of rosbag2 folders, with this storage."""

    STORAGE_PLUGINS = {StoragePlugin.MCAP: LargeMessageStorage}  # noqa: RUF012  # rosbags declares it so


_MAGIC = b"\x89MCAP0\r\n"
_FOOTER_BYTES = _LENGTH + 20 + len(_MAGIC)  # the record 0x02 with two offsets and a checksum, and the magic
_MOST_SUMMARY_BYTES = 64 * 1024**2


def bag_metadata(path: Path) -> bytes:
    """The metadata that rosbag2 keeps within an MCAP file (the record `rosbag2`), as YAML; empty where there is none.

    Raises:
        OSError: when it cannot be read.
        ValueError: when it is no MCAP file, or its summary cannot be read; struct.error likewise.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - _FOOTER_BYTES, 0))
        footer = file.read(_FOOTER_BYTES)
        if len(footer) < _FOOTER_BYTES or not footer.endswith(_MAGIC) or footer[0] != 0x02:
            raise ValueError(f"{path} is no MCAP file")
        (start,) = struct.unpack_from("<Q", footer, _LENGTH)
        if not 0 < start <= size or size - start > _MOST_SUMMARY_BYTES:
            return b""
        file.seek(start)
        summary = file.read(size - start - _FOOTER_BYTES)
        place = 0
        while place + _LENGTH <= len(summary):
            opcode, length = struct.unpack_from("<BQ", summary, place)
            place += _LENGTH
            if opcode == 0x0D:  # index of a metadata record: where, how long, its name
                where, bytes_, letters = struct.unpack_from("<QQI", summary, place)
                if summary[place + 20 : place + 20 + letters] == b"rosbag2" and bytes_ <= _MOST_SUMMARY_BYTES:
                    file.seek(where)
                    return file.read(bytes_)
            place += length
    return b""
