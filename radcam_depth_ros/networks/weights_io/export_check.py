"""Checks an exported file before torch reads it: TorchScript can write files, even while it is loaded.

torch reads the pickles of a TorchScript file with an unpickler of its own, which makes tensors, plain values and
TorchScript's classes, and calls no Python. What is left is the code beside them: all but two of torch's own operators
compute and nothing else.
"""

from __future__ import annotations

import io
import tokenize
import zipfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

LARGEST_BYTES = 2 * 1024**3
"""No weights are larger: the file, and what an archive's entries become."""
LARGEST_CARD_BYTES = 64 * 1024
# Operators that read and write files, and what runs while a file is read.
_FORBIDDEN = {"save", "from_file", "__setstate__"}
_OPERATORS = {"aten", "prim"}


def find_fault(path: Path, card_entry: str) -> str:
    """Why a TorchScript file is not to be read; empty where nothing speaks against it.

    Args:
        path: The file; one that is no archive has no fault here, since torch refuses it.
        card_entry: Name of the card's entry.
    """
    if path.stat().st_size > LARGEST_BYTES:
        return f"it has {path.stat().st_size} bytes, more than {LARGEST_BYTES}"
    try:
        with zipfile.ZipFile(path) as archive:
            return _fault_of(archive, card_entry)
    except zipfile.BadZipFile:
        return ""
    except (OSError, RuntimeError, NotImplementedError, UnicodeDecodeError, SyntaxError, tokenize.TokenError) as error:
        return f"its code cannot be read: {error}"


def _fault_of(archive: zipfile.ZipFile, card_entry: str) -> str:
    entries = archive.infolist()
    if len({entry.filename for entry in entries}) < len(entries):
        return "two of its entries have the same name"
    if sum(entry.file_size for entry in entries) > LARGEST_BYTES:
        return f"its entries become more than {LARGEST_BYTES} bytes"
    for entry in entries:
        if entry.filename.endswith(card_entry) and entry.file_size > LARGEST_CARD_BYTES:
            return f"its card has {entry.file_size} bytes, more than {LARGEST_CARD_BYTES}"
        fault = _fault_of_code(archive.read(entry).decode()) if entry.filename.endswith(".py") else ""
        if fault:
            return fault
    return ""


def _fault_of_code(code: str) -> str:
    words = list(_words(code))
    for word, following in pairwise([*words, ""]):
        if word in _FORBIDDEN:
            return f"its code has {word!r}, which can do more than compute"
        if word == "ops" and following not in _OPERATORS:
            return f"its code has operators of {following!r}, which are not torch's own"
    return ""


def _words(code: str) -> Iterator[str]:
    """Names and texts, in their order, whatever stands between them."""
    for token in tokenize.generate_tokens(io.StringIO(code).readline):
        if token.type in (tokenize.NAME, tokenize.STRING):
            yield token.string.strip("\"'")
