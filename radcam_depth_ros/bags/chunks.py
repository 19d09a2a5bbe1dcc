"""Reads MCAP files chunk by chunk, each bounded before it is unpacked.

rosbags unpacks a chunk before it looks at its size, and holds all chunks whose times overlap.
"""

from __future__ import annotations

import heapq
import struct
from binascii import crc32
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader

from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.unpacking import MOST_OPEN_BYTES, check_size, mebibytes, unpack

# Opcodes and layouts of the MCAP specification, little endian.
_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # first and last time, size, checksum, letters of the compression's name
_SCHEMA_OPCODE, _CHANNEL_OPCODE, _MESSAGE_OPCODE, _CHUNK_OPCODE = 0x03, 0x04, 0x05, 0x06

_MOST_DESCRIBED_BYTES = 64 * 1024**2  # of all schemas and channels, which are held
_ENTRY_BYTES = 256  # that a message takes while its chunk is held, beside its content


@dataclass
class _Held:
    """Memory of all chunks that one reading holds.

    Attributes:
        size: Bytes.
    """

    size: int = 0

    def check(self, more: int) -> None:
        if self.size + more > MOST_OPEN_BYTES:
            raise BagError(
                f"chunks of the same time take more than the {mebibytes(MOST_OPEN_BYTES)} that are held at once; "
                "sort the bag with `mcap sort`"
            )


class BoundedMcapReader(McapReader):  # type: ignore[misc]  # rosbags is read without types
    """rosbags' reader of MCAP files, with bounds on chunks, on what is held of them and on schemas."""

    _scanned = False

    def open(self) -> None:
        """Opens the file; BagError beyond the bounds, rosbags' errors where it is damaged."""
        self._scanned = False
        super().open()

    def meta_scan(self) -> None:
        """Lists topics of a file without an index; BagError beyond the bounds."""
        self._check_without_index()
        super().meta_scan()

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[Connection, int, bytes | memoryview]]:
        """The messages in the order of their log times; contents are views of their chunks.

        Args:
            connections: Those to read.
            start: The first log time to read, nanoseconds.
            stop: The first log time after that, nanoseconds.

        Raises:
            BagError: for chunks beyond the bounds, or damaged ones.
        """
        if not self.chunks:
            self._check_without_index()
            yield from super().messages(connections, start, stop)
            return
        self._check_index()
        wanted = {connection.id: connection for connection in connections}
        held = _Held()
        parts = [
            self._messages_of(
                chunk, wanted, range(max(first, start or first), min(end, end if stop is None else stop)), held
            )
            for chunk in self.chunks
            for first, end in [(chunk.message_start_time, chunk.message_end_time + 1)]
            if any(chunk.channel_count.get(channel, 0) for channel in wanted)
        ]
        for log_time_ns, _, connection, content in heapq.merge(*parts, key=itemgetter(0, 1)):
            if connection is not None:
                yield connection, log_time_ns, content

    def _messages_of(
        self, chunk: ChunkInfo, wanted: dict[int, Connection], times: range, held: _Held
    ) -> Iterator[tuple[int, int, Connection | None, Any]]:
        if not times:
            return
        yield chunk.message_start_time, 0, None, None  # the chunk is read when this comes first
        content, entries = self._content_of(chunk, held), []
        for opcode, begin, end in _records(content):
            if opcode != _MESSAGE_OPCODE:
                continue
            channel, _, log_time_ns, _ = _MESSAGE.unpack_from(content, begin)
            if log_time_ns in times and channel in wanted:
                entries.append((log_time_ns, channel, begin + _MESSAGE.size, end))
                held.check(len(content) + _ENTRY_BYTES * len(entries))
        taken = len(content) + _ENTRY_BYTES * len(entries)
        held.size += taken
        try:
            entries.sort(key=itemgetter(0))
            for log_time_ns, channel, begin, end in entries:
                yield log_time_ns, chunk.chunk_start_offset, wanted[channel], content[begin:end]
        finally:
            held.size -= taken

    def _content_of(self, chunk: ChunkInfo, held: _Held) -> memoryview:
        for size in (chunk.compressed_size, chunk.uncompressed_size):
            check_size(size)
        held.check(chunk.uncompressed_size)
        file = self.bio
        file.seek(chunk.chunk_start_offset + _RECORD.size)
        *_, checksum, letters = _CHUNK.unpack(file.read(_CHUNK.size))
        file.seek(letters + 8, 1)
        packed = file.read(chunk.compressed_size)
        content = unpack(packed, chunk.compression, chunk.uncompressed_size)
        if checksum and crc32(content) != checksum:
            raise ValueError("the checksum of a chunk is wrong")
        return memoryview(content)

    def _check_index(self) -> None:
        # Chunks that share bytes of the file are unpacked once for each entry of the index.
        spans = sorted((chunk.chunk_start_offset, chunk.compressed_size) for chunk in self.chunks)
        for (start, size), (following, _) in pairwise(spans):
            if start + size > following:
                raise ValueError("chunks of the index overlap")

    def _check_without_index(self) -> None:
        """Looks at all chunks of a file that rosbags reads from its beginning to its end, once."""
        if self._scanned:
            return
        file, described = self.bio, 0
        file.seek(self.data_start)
        while (place := file.tell() + _RECORD.size) < self.data_end:
            opcode, length = _RECORD.unpack(file.read(_RECORD.size))
            if opcode == _CHUNK_OPCODE:
                check_size(length)
                *_, size, _, letters = _CHUNK.unpack(file.read(_CHUNK.size))
                compression = file.read(min(letters, length)).decode()
                (packed_size,) = struct.unpack("<Q", file.read(8))
                content = memoryview(unpack(file.read(min(packed_size, length)), compression, size))
                described += sum(end - begin for inner, begin, end in _records(content) if _describes(inner))
            elif opcode == _MESSAGE_OPCODE:
                check_size(length)
            elif _describes(opcode):
                described += length
            if described > _MOST_DESCRIBED_BYTES:
                raise BagError(
                    f"schemas and channels take more than {mebibytes(_MOST_DESCRIBED_BYTES)}; record the bag again"
                )
            file.seek(place + length)
        self._scanned = True


def _describes(opcode: int) -> bool:
    return opcode in (_SCHEMA_OPCODE, _CHANNEL_OPCODE)


def _records(content: memoryview) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of each record of a chunk; ValueError where a record ends after the chunk."""
    place, end = 0, len(content)
    while place < end:
        opcode, length = _RECORD.unpack_from(content, place)
        begin = place + _RECORD.size
        place = begin + length
        if place > end or (opcode == _MESSAGE_OPCODE and length < _MESSAGE.size):
            raise ValueError("a record ends after its chunk")
        yield opcode, begin, place
