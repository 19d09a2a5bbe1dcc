"""Reads tables of JSON row by row: memory does not grow with a table."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from radcam_depth_ros.datasets.errors import DatasetError

_CHUNK = 1 << 20
_LONGEST_ROW = 16 * _CHUNK
"""Characters. No row of a table is this long: what is, is damaged."""
_GAP = re.compile(r"[\s,]*")


def read_rows(path: Path, fields: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    """The rows of a table in their order.

    Args:
        path: A JSON file with an array of objects.
        fields: What each row must have.

    Raises:
        DatasetError: for a file that is missing, no such array, cut off, or of rows without these fields.
    """
    try:
        with path.open(encoding="utf-8") as file:
            for row in _objects(path, file.read):
                if not all(name in row for name in fields):
                    raise DatasetError(
                        f"expected rows with {', '.join(fields)} in {path}, got {', '.join(sorted(row)) or 'none'}; "
                        "give the folder of a data set in the schema of nuScenes"
                    )
                yield row
    except OSError as error:
        raise DatasetError(
            f"cannot read the table {path}: {error.strerror}; unpack the data set's metadata there"
        ) from None
    except UnicodeDecodeError:
        raise _damaged(path, "text that is not UTF-8") from None


def _objects(path: Path, read: Any) -> Iterator[dict[str, Any]]:
    decode = json.JSONDecoder().raw_decode
    text = read(_CHUNK)
    start = text.find("[")
    if start < 0 or text[:start].strip():
        raise _damaged(path, repr(text[:20]))
    place = start + 1
    while True:
        place = _GAP.match(text, place).end()  # type: ignore[union-attr]  # matches anything
        if text.startswith("]", place):
            return
        try:
            row, place = decode(text, place)
        except RecursionError:
            raise _damaged(path, "a row of lists within lists") from None
        except ValueError:
            more = read(_CHUNK)
            if not more or len(text) - place > _LONGEST_ROW:
                raise _damaged(path, "an end within a row" if not more else "a row that does not end") from None
            text, place = text[place:] + more, 0
            continue
        if not isinstance(row, dict):
            raise _damaged(path, f"a row {str(row)[:20]!r}")
        yield row


def _damaged(path: Path, what: str) -> DatasetError:
    return DatasetError(f"expected a whole JSON array of objects in {path}, got {what}; unpack the metadata anew")
