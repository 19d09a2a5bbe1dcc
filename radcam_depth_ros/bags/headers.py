"""Reads the header at the beginning of a serialised message, and nothing else of it."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from radcam_depth_ros.bags.errors import BagError

_ENCAPSULATION = 4  # CDR's own header: its second byte tells the byte order
_FIXED = 16  # to the first character of frame_id


@dataclass(frozen=True)
class Header:
    """A std_msgs/Header.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: As published; may be empty.
    """

    stamp_ns: int
    frame_id: str


def header_stamp_ns(raw: bytes) -> int:
    """The stamp of a serialised (CDR) message that begins with a std_msgs/Header, nanoseconds."""
    seconds, nanoseconds = struct.unpack_from(f"{_byte_order(raw)}iI", raw, _ENCAPSULATION)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def read_header(raw: bytes) -> Header:
    """The header of a serialised (CDR) message that begins with one.

    Raises:
        BagError: for bytes that are none.
    """
    try:
        stamp_ns = header_stamp_ns(raw)
        (size,) = struct.unpack_from(f"{_byte_order(raw)}I", raw, _FIXED - 4)
    except (struct.error, IndexError) as error:
        raise BagError(f"a message of {len(raw)} bytes has no header; the bag is damaged, record it again") from error
    if len(raw) < _FIXED + size:
        raise BagError(f"a header of {size} bytes in a message of {len(raw)}; the bag is damaged, record it again")
    frame_id = bytes(raw[_FIXED : _FIXED + size]).rstrip(b"\0")
    return Header(stamp_ns, frame_id.decode("utf-8", errors="replace"))


def _byte_order(raw: bytes) -> str:
    return "<" if raw[1] & 1 else ">"
