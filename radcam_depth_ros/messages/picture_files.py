"""Reads the size of a JPEG or PNG before it is decoded: a file of a kilobyte may claim gigabytes."""

from __future__ import annotations

import struct

_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD8)}  # TEM and the restart marks
# SOF0 to SOF15; of that range DHT, JPG and DAC are no frame headers.
_FRAME_HEADERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}


def file_size(content: bytes) -> tuple[int, int] | None:
    """Width and height in the header of a JPEG or PNG (ITU T.81 annex B, PNG section 11.2.2).

    Returns:
        Both in pixels; None where there is no whole header, or one of zeros.
    """
    size = _png_size(content) if content.startswith(b"\x89PNG") else _jpeg_size(content)
    return size if size is not None and min(size) > 0 else None


def scan_count(content: bytes) -> int:
    """How many scans a JPEG has: the decoder visits all pixels once for each, so that a small file can take minutes.

    Within a scan's data the bytes FF DA do not occur (ITU T.81, B.1.1.5); what else holds them is counted as well.
    """
    return content.count(bytes((0xFF, _START_OF_SCAN)))


def _png_size(content: bytes) -> tuple[int, int] | None:
    if len(content) < 24 or content[12:16] != b"IHDR":
        return None
    width, height = struct.unpack_from(">II", content, 16)
    return int(width), int(height)


def _jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Goes from mark to mark as libjpeg does, which skips what lies between them."""
    at = 2
    while (at := content.find(b"\xff", at)) >= 0 and at + 9 <= len(content):
        mark = content[at + 1]
        if mark in _FRAME_HEADERS:
            height, width = struct.unpack_from(">HH", content, at + 5)
            return int(width), int(height)
        if mark in (_START_OF_SCAN, _END_OF_IMAGE):
            return None
        if mark in (0x00, 0xFF):  # no mark, or filling before one
            at += 1
        elif mark in _WITHOUT_LENGTH:
            at += 2
        else:
            at += 2 + max(2, int.from_bytes(content[at + 2 : at + 4], "big"))
    return None
