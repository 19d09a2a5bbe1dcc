"""Unpacks zstd and LZ4 within bounds: neither format says reliably how long its content is."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from lz4.frame import LZ4FrameDecompressor

from radcam_depth_ros.bags.errors import BagError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MOST_BYTES = 512 * 1024**2
"""Of a chunk and of a message, unpacked. Recordings have chunks of a few MiB, and messages of at most some 100 MB."""
MOST_OPEN_BYTES = 4 * MOST_BYTES
"""Of all chunks that are held at the same time, since their times overlap."""
MOST_EXPANSION = 1000
"""Length of an unpacked file against the packed one. Recordings shrink by a factor of 2 to 20."""

_PIECE_BYTES = 16 * 1024**2  # unpacked at a time; most chunks are shorter
_MOST_FRAMES = 64  # each copies what follows it; recordings have one
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_SKIPPABLE_MAGIC = b"\x2a\x4d\x18"  # after a first byte from 0x50 to 0x5f


def mebibytes(size: int) -> str:
    """A size as the sentences of errors say it."""
    return f"{size / 1024**2:,.0f} MiB"


def unpack(packed: bytes | memoryview, compression: str, size: int | None = None) -> bytes | bytearray:
    """The content of a chunk or a message.

    Args:
        packed: As it lies in the bag.
        compression: `zstd`, `lz4`, or empty for none.
        size: How long the content is said to be, bytes; None where nothing says so.

    Raises:
        BagError: for content that is longer than `MOST_BYTES` or `size`.
        ValueError: for an unknown compression, and content that is damaged or shorter than `size`.
    """
    check_size(max(len(packed), size or 0))
    most = MOST_BYTES if size is None else size
    if not compression:
        content: bytes | bytearray = bytes(packed)
    else:
        content = bytearray()
        for piece in _pieces(packed, compression):
            if len(content) + len(piece) > most:
                raise BagError(
                    f"{len(packed):,} bytes of the bag expand to more than "
                    + (mebibytes(most) if size is None else f"the {size:,} bytes that they declare")
                    + "; record or compress the bag again"
                )
            content += piece
    if size is not None and len(content) != size:
        raise ValueError(f"a chunk declares {size:,} bytes and has {len(content):,}")
    return content


def check_size(size: int) -> None:
    """Refuses a chunk or a message by the size that it declares, before memory is taken for it.

    Raises:
        BagError: beyond `MOST_BYTES`.
    """
    if size > MOST_BYTES:
        raise BagError(
            f"a chunk or message of {mebibytes(size)} is beyond the {mebibytes(MOST_BYTES)} that are read at once; "
            "record the bag in smaller chunks"
        )


def check_packed_files(folder: Path) -> None:
    """Refuses a bag whose zstd files would fill the disk, since rosbags unpacks them into a temporary folder.

    They are unpacked once more for this, piece by piece and into nothing: many writers do not declare the length.

    Args:
        folder: A rosbag2 folder.

    Raises:
        BagError: for a file that expands beyond `MOST_EXPANSION`, or needs more than half of the free space.
        OSError: when a file cannot be read.
        ValueError: for a damaged file.
    """
    place = tempfile.gettempdir()
    left = shutil.disk_usage(place).free // 2
    for path in sorted(folder.iterdir()):
        if not path.is_file() or not _is_zstd(path):
            continue
        packed = path.stat().st_size
        most = min(left, MOST_EXPANSION * packed)
        length = _unpacked_length(path, most)
        if length > left:
            raise BagError(
                f"{path} does not fit into half of the free space of {place} when it is unpacked; unpack the bag with "
                "`ros2 bag convert`, or set TMPDIR to a larger disk"
            )
        if length > most:
            raise BagError(
                f"{path} of {packed:,} bytes expands to more than {MOST_EXPANSION} times as much; "
                "unpack the bag with `ros2 bag convert` if you trust it"
            )
        left -= length


def _pieces(packed: bytes | memoryview, compression: str) -> Iterator[bytes]:
    makers = {"zstd": zstd.ZstdDecompressor, "lz4": LZ4FrameDecompressor}
    if compression not in makers:
        raise ValueError(f"the compression {compression!r} of a chunk is unknown")
    rest: bytes | memoryview = packed
    for _ in range(_MOST_FRAMES):
        decompressor = makers[compression]()
        try:
            yield decompressor.decompress(rest, max_length=_PIECE_BYTES)
            while not decompressor.eof:
                if decompressor.needs_input:
                    raise EOFError("it ends early")
                yield decompressor.decompress(b"", max_length=_PIECE_BYTES)
        except (zstd.ZstdError, RuntimeError, EOFError) as error:
            raise ValueError(f"a chunk or message is no {compression}: {error}") from error
        rest = decompressor.unused_data or b""
        if not rest:
            return
    raise BagError(f"a chunk has more than {_MOST_FRAMES} {compression} frames; record or compress the bag again")


def _is_zstd(path: Path) -> bool:
    with path.open("rb") as file:
        start = file.read(4)
    return start == _ZSTD_MAGIC or (start[1:] == _SKIPPABLE_MAGIC and start[0] >> 4 == 5)


def _unpacked_length(path: Path, most: int) -> int:
    """What a zstd file is unpacked, bytes; where it is longer than `most`, only that."""
    length, piece = 0, bytearray(_PIECE_BYTES)
    with zstd.open(path, "rb") as content:
        try:
            while length <= most and (read := content.readinto(piece)):
                length += read
        except (zstd.ZstdError, EOFError) as error:
            raise ValueError(f"{path.name} is no zstd file: {error}") from error
    return length
