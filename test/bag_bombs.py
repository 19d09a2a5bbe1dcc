"""Bags that are small on the disk and declare, or are, very large."""

from __future__ import annotations

import functools
import struct
from pathlib import Path

import lz4.frame
from rosbags.rosbag2.storage_mcap import zstd

MIB = 1024**2
MAGIC = b"\x89MCAP0\r\n"
IMAGE = "sensor_msgs/msg/Image"


def text(value: str | bytes) -> bytes:
    raw = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(raw)) + raw


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def schema_record(type_name: str = IMAGE, definition: str = "uint8[] data\n", encoding: str = "ros2msg") -> bytes:
    return record(0x03, struct.pack("<H", 1) + text(type_name) + text(encoding) + text(definition))


CHANNEL = record(0x04, struct.pack("<HH", 1, 1) + text("/camera/image_raw") + text("cdr") + text(""))


def message_record(content: bytes, log_time_ns: int = 5) -> bytes:
    return record(0x05, struct.pack("<HIQQ", 1, 0, log_time_ns, log_time_ns) + content)


@functools.cache
def packed_zeros(compression: str, size: int) -> bytes:
    """Zeros, packed piece by piece: this process holds none of them."""
    if compression == "zstd":
        compressor = zstd.ZstdCompressor()
        parts = [compressor.compress(bytes(MIB)) for _ in range(size // MIB)]
        return b"".join([*parts, compressor.flush()])
    packer = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    parts = [packer.begin(), *(packer.compress(bytes(MIB)) for _ in range(size // MIB)), packer.flush()]
    return b"".join(parts)


def chunk_record(packed: bytes, compression: str, declared: int, times: tuple[int, int] = (5, 5)) -> bytes:
    head = struct.pack("<QQQI", *times, declared, 0)
    return record(0x06, head + text(compression) + struct.pack("<Q", len(packed)) + packed)


def write_mcap(path: Path, chunks: list[bytes], *, indexed: bool = True, schema: bytes = b"") -> Path:
    """An MCAP file of these chunk records, with a summary or without."""
    content = MAGIC + record(0x01, text("ros2") + text(""))
    entries = b""
    schema = schema or schema_record()
    if not indexed:
        content += schema + CHANNEL
    for chunk in chunks:
        first, last, size, _, letters = struct.unpack_from("<QQQII", chunk, 9)
        name = chunk[41 : 41 + letters]
        (packed,) = struct.unpack_from("<Q", chunk, 41 + letters)
        offsets = struct.pack("<IHQ", 10, 1, len(content) + len(chunk))
        index = record(0x07, struct.pack("<HIQQ", 1, 16, first, 0))
        span = struct.pack("<QQQQ", first, last, len(content), len(chunk))
        entries += record(
            0x08, span + offsets + struct.pack("<Q", len(index)) + text(name) + struct.pack("<QQ", packed, size)
        )
        content += chunk + index
    content += record(0x0F, bytes(4))
    start = len(content) if indexed else 0
    if indexed:
        content += schema + CHANNEL + entries
    path.write_bytes(content + record(0x02, struct.pack("<QQI", start, 0, 0)) + MAGIC)
    return path
