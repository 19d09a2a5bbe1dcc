"""Reads the point files of data sets: binary PCD, and rows of float32."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.datasets.errors import DatasetError

Columns = dict[str, npt.NDArray[np.generic]]
"""(N,) arrays of one length by the fields' names."""
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"f": (4, 8), "i": (1, 2, 4), "u": (1, 2, 4)}
"""Bytes of the types that a sensor_msgs/PointCloud2 has."""
_LONGEST_HEADER = 65_536


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


def read_pcd(content: bytes, name: str, fields: tuple[str, ...], *, others: bool = False) -> Columns:
    """Points of a binary PCD file; none where the first one is NaN, as nuScenes marks an empty sweep.

    Args:
        content: The file. Bytes after the last point are ignored.
        name: The file, for sentences.
        fields: The fields that it must have, in their order.
        others: Whether it may have others as well, and in any order.

    Raises:
        DatasetError: for a file that is no such PCD, is not binary, has other fields or is cut off.
    """
    header, start = _header(content, name)
    names = tuple(header["FIELDS"])
    if names != fields and not (others and set(fields) <= set(names)):
        raise DatasetError(
            f"expected the fields {' '.join(fields)} in {name}, got {' '.join(names)}; give the data set's own files"
        )
    if header["DATA"] != ["binary"]:
        raise DatasetError(
            f"expected DATA binary in {name}, got DATA {' '.join(header['DATA'])}; save it as a binary PCD"
        )
    dtype = _point_type(header, name)
    count = _whole(header["WIDTH"], name) * _whole(header["HEIGHT"], name)
    if len(content) - start < count * dtype.itemsize:
        raise DatasetError(
            f"expected {count} points of {dtype.itemsize} bytes in {name}, got {len(content) - start} bytes; copy the "
            "file anew"
        )
    points = np.frombuffer(content, dtype, count, start)
    if count and math.isnan(float(points[names[0]][0])):
        points = points[:0]
    return {field: np.ascontiguousarray(points[field]) for field in names}


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
        if not size.isdecimal() or int(size) not in _SIZES.get(code, ()):
            raise DatasetError(
                f"expected numbers that a point cloud message holds in {name}, got TYPE {kind} of SIZE {size} for "
                f"{field}; convert them"
            )
        columns.append((field, f"<{code}{size}"))
    return np.dtype(columns)


def _whole(words: list[str], name: str) -> int:
    if len(words) != 1 or not words[0].isdecimal():
        raise DatasetError(
            f"expected whole numbers for WIDTH and HEIGHT in {name}, got {' '.join(words)}; copy it anew"
        )
    return int(words[0])
