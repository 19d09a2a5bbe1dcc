"""Reads the point files of data sets: PCD, binary or compressed, and rows of float32."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.datasets.errors import DatasetError

Columns = dict[str, npt.NDArray[np.generic]]
"""(N,) arrays of one length by the fields' names."""
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"f": ("4", "8"), "i": ("1", "2", "4", "8"), "u": ("1", "2", "4", "8")}
_LONGEST_HEADER = 65_536
_LITERALS = 32
_MOST_DIGITS = 12


def read_floats(content: bytes, name: str, fields: tuple[str, ...]) -> Columns:
    """Points that are stored as rows of float32, little endian.

    Args:
        content: The file.
        name: The file, for sentences.
        fields: One for each value of a row.

    Raises:
        DatasetError: for a file that ends within a point.
    """
    if len(content) % (4 * len(fields)):
        raise DatasetError(
            f"expected points of {4 * len(fields)} bytes ({' '.join(fields)}) in {name}, got {len(content)} bytes, "
            "which is no whole number of them; copy the file anew"
        )
    values = np.frombuffer(content, "<f4").reshape(-1, len(fields))
    return {field: np.ascontiguousarray(values[:, index]) for index, field in enumerate(fields)}


def read_pcd(content: bytes, name: str, fields: tuple[str, ...], *, exactly: bool = True) -> Columns:
    """Points of a PCD file, binary or compressed; none where the first one is NaN, as nuScenes marks an empty sweep.

    Args:
        content: The file. Bytes after the last point are ignored.
        name: The file, for sentences.
        fields: The fields that are read.
        exactly: Whether the file must have these in this order, and no others.

    Raises:
        DatasetError: for a file that is no such PCD, is text, has other fields or is cut off.
    """
    header, start = _header(content, name)
    names = tuple(header["FIELDS"])
    if names != fields if exactly else not set(fields) <= set(names):
        raise DatasetError(
            f"expected the fields {' '.join(fields)} in {name}, got {' '.join(names)}; give the data set's own files"
        )
    dtype = _point_type(header, name)
    count = _whole(header["WIDTH"], name) * _whole(header["HEIGHT"], name)
    columns: Columns
    if header["DATA"] == ["binary"]:
        if len(content) - start < count * dtype.itemsize:
            raise _cut_off(name, count, dtype, len(content) - start)
        points = np.frombuffer(content, dtype, count, start)
        columns = {field: np.ascontiguousarray(points[field]) for field in fields}
    elif header["DATA"] == ["binary_compressed"]:
        columns = _compressed(content[start:], count, dtype, name)
    else:
        raise DatasetError(
            f"expected DATA binary in {name}, got DATA {' '.join(header['DATA'])}; save it as a binary PCD"
        )
    if count and math.isnan(float(columns[names[0]][0])):
        columns = {field: column[:0] for field, column in columns.items()}
    return {field: columns[field] for field in fields}


def _compressed(content: bytes, count: int, dtype: np.dtype[np.void], name: str) -> Columns:
    """The columns of a compressed PCD, which has them one after the other."""
    packed, size = (int.from_bytes(content[place : place + 4], "little") for place in (0, 4))
    if size != count * dtype.itemsize or len(content) < 8 + packed:
        raise _cut_off(name, count, dtype, min(size, len(content)))
    values, place, columns = unpack_lzf(content[8 : 8 + packed], size), 0, {}
    if len(values) != size:
        raise _cut_off(name, count, dtype, len(values))
    for field in dtype.names or ():
        columns[field] = np.frombuffer(values, dtype[field], count, place)
        place += count * dtype[field].itemsize
    return columns


def unpack_lzf(packed: bytes, size: int) -> bytes:
    """Unpacks LZF, by which a compressed PCD is packed; less than `size` bytes where it is damaged, never more."""
    found, place, end = bytearray(), 0, len(packed)
    while place < end and len(found) < size:
        control = packed[place]
        place += 1
        if control < _LITERALS:  # that many bytes and one more, as they are
            found += packed[place : place + control + 1]
            place += control + 1
            continue
        length = control >> 5
        if length == 7 and place < end:
            length += packed[place]
            place += 1
        back = len(found) - ((control & 31) << 8) - (packed[place] if place < end else 0) - 1
        place += 1
        if back < 0:
            break
        for index in range(back, back + length + 2):  # what is copied may be what is being written
            found.append(found[index])
    return bytes(found[:size])


def _cut_off(name: str, count: int, dtype: np.dtype[np.void], size: int) -> DatasetError:
    return DatasetError(
        f"expected {count} points of {dtype.itemsize} bytes in {name}, got {size} bytes; copy the file anew"
    )


def _header(content: bytes, name: str) -> tuple[dict[str, list[str]], int]:
    """The header's entries, and where the points start."""
    found: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in found:
        end = content.find(b"\n", start, _LONGEST_HEADER)
        if end < 0:
            break
        words = content[start:end].decode("ascii", "replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            found[words[0]] = words[1:]
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA") if not found.get(key)]
    if missing:
        raise DatasetError(f"expected a PCD file with {', '.join(missing)} in its header, got {name}; copy it anew")
    return found, start


def _point_type(header: dict[str, list[str]], name: str) -> np.dtype[np.void]:
    names, counts = header["FIELDS"], header.get("COUNT", ["1"] * len(header["FIELDS"]))
    columns = []
    if len(set(names)) != len(names):
        raise DatasetError(f"expected fields of different names in {name}, got {' '.join(names)}; save it anew")
    if {len(header[key]) for key in ("SIZE", "TYPE")} != {len(names)} or counts != ["1"] * len(names):
        raise DatasetError(f"expected a SIZE, a TYPE and a COUNT of 1 for each of the fields of {name}; copy it anew")
    for field, size, kind in zip(names, header["SIZE"], header["TYPE"], strict=True):
        code = _KINDS.get(kind, "")
        if size not in _SIZES.get(code, ()):
            raise DatasetError(
                f"expected numbers of 1 to 8 bytes in {name}, got TYPE {kind} of SIZE {size} for "
                f"{field}; copy the file anew"
            )
        columns.append((field, f"<{code}{size}"))
    return np.dtype(columns)


def _whole(words: list[str], name: str) -> int:
    if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > _MOST_DIGITS:
        raise DatasetError(
            f"expected whole numbers for WIDTH and HEIGHT in {name}, got {' '.join(words)[:60]}; copy it anew"
        )
    return int(words[0])
