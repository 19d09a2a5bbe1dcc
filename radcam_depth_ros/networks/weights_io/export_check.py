"""Checks an exported file before torch reads it: TorchScript can write files, even while it is loaded.

All checks are of the bytes that torch is then given, never of the path again, and of what torch's own reader finds in
them: archives can be made that Python and torch read differently. Nothing is allowed but what an export of this package
has: its entries, tensors and plain values in the pickles, and code that computes (`operators`).
"""

from __future__ import annotations

import ast
import io
import pickle  # nosec B403  # makes nothing but inert values, see `_Storages`
import pickletools  # nosec B403  # lists a pickle's operations without running them
import re
import zipfile
import zlib
from collections.abc import Iterator
from typing import Any

import torch

from radcam_depth_ros.networks.weights_io.operators import BUILT_INS, OPERATORS, PRIMITIVES

LARGEST_BYTES = 2 * 1024**3
"""No weights are larger."""
LARGEST_CARD_BYTES = 64 * 1024
LARGEST_CODE_BYTES = 4 * 1024**2
_ENTRY = re.compile(
    r"data\.pkl|constants\.pkl|version|byteorder|\.data/serialization_id|(constants|data)/\d+"
    r"|code/__torch__(/\w+)+\.py(\.debug_pkl)?|extra/card\.yaml"
)
_GLOBAL = re.compile(
    r"__torch__\.(?!torch\.)\w+(\.\w+)*|collections OrderedDict|torch \w+Storage|torch\._utils _rebuild_tensor_v2"
    r"|torch\.jit\._pickle build_\w+list"
)
_ITEM_BYTES = {
    **{"FloatStorage": 4, "DoubleStorage": 8, "HalfStorage": 2, "BFloat16Storage": 2, "BoolStorage": 1},
    **{"LongStorage": 8, "IntStorage": 4, "ShortStorage": 2, "CharStorage": 1, "ByteStorage": 1},
}
"""Bytes of a value in each kind of storage."""
_NODES = (
    *(ast.Module, ast.ClassDef, ast.FunctionDef, ast.arguments, ast.arg, ast.Pass, ast.Assign, ast.AnnAssign),
    *(ast.If, ast.For, ast.While, ast.Expr, ast.Return, ast.Call, ast.keyword, ast.Attribute, ast.Name, ast.Constant),
    *(ast.List, ast.Tuple, ast.Dict, ast.Subscript, ast.Slice, ast.UnaryOp, ast.BinOp, ast.BoolOp, ast.Compare),
    *(ast.IfExp, ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop),
)


class ExportError(Exception):
    """Why an exported file is not to be read."""


def check_export(content: bytes) -> None:
    """Refuses a TorchScript file that could do more than compute.

    Args:
        content: The file's bytes.

    Raises:
        ExportError: with the reason.
    """
    entries = _by_python(content)
    if _by_torch(content) != entries:
        raise ExportError("torch reads other entries in it than Python")
    for name, data in entries.items():
        if name == "extra/card.yaml" and len(data) > LARGEST_CARD_BYTES:
            raise ExportError(f"its card has {len(data)} bytes, more than {LARGEST_CARD_BYTES}")
        if name.endswith(".py"):
            _check_code(data)
        elif name.endswith((".pkl", "_pkl")):
            _check_pickle(data)
    for name in ("data", "constants"):
        _check_storages(name, entries)


def check_graph(module: torch.jit.ScriptModule) -> None:
    """Refuses a module of which torch has understood anything that is not allowed, before it runs.

    Raises:
        ExportError: with the operator.
    """
    for kind in _kinds(module.inlined_graph):
        space, _, name = kind.partition("::")
        if name not in {"aten": OPERATORS, "prim": PRIMITIVES}.get(space, ()):
            raise ExportError(f"its code has the operator {kind!r}, which exports of this package do not have")


def _by_python(content: bytes) -> dict[str, bytes]:
    """All entries of the archive, read whole, without the folder that they share."""
    if not content.startswith(b"PK\x03\x04"):
        raise ExportError("it is no archive")
    entries: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if archive.comment:
                raise ExportError("its archive has a comment")
            for entry in archive.infolist():
                # torch compresses the code alone.
                most = len(content) if entry.compress_type == zipfile.ZIP_STORED else LARGEST_CODE_BYTES
                if entry.flag_bits & 1 or entry.file_size > most:
                    raise ExportError(f"its entry {entry.filename!r} is encrypted, or becomes {entry.file_size} bytes")
                _, _, name = entry.filename.partition("/")
                if not _ENTRY.fullmatch(name):
                    raise ExportError(f"its entry {entry.filename!r} is none that an export has")
                if name in entries:
                    raise ExportError("two of its entries have the same name")
                entries[name] = archive.read(entry)
            folders = {entry.filename.partition("/")[0] for entry in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, NotImplementedError, ValueError, EOFError) as error:
        raise ExportError(f"Python cannot read all of it: {error}") from None
    if len(folders) != 1:
        raise ExportError("its entries are not in one folder")
    if len({name.lower() for name in entries}) < len(entries):
        raise ExportError("two of its entries differ in nothing but the case of letters")
    return entries


def _by_torch(content: bytes) -> dict[str, bytes]:
    try:
        reader: Any = torch._C.PyTorchFileReader(io.BytesIO(content))
        return {name: reader.get_record(name) for name in reader.get_all_records()}
    except (RuntimeError, ValueError) as error:
        raise ExportError(f"torch cannot read it: {str(error).splitlines()[0]}") from None


def _check_pickle(data: bytes) -> None:
    try:
        for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
            # torch makes room for all numbers up to this one: a few bytes would take 10 GB.
            if opcode.name in ("PUT", "BINPUT", "LONG_BINPUT") and not 0 <= int(argument or 0) <= count:
                raise ExportError(f"one of its pickles remembers its value {count} as number {argument}")
            if opcode.name == "GLOBAL" and not _GLOBAL.fullmatch(_joined(str(argument))):
                raise ExportError(f"one of its pickles makes {str(argument)!r}, which is neither a tensor nor its own")
            if opcode.name in ("STACK_GLOBAL", "INST", "EXT1", "EXT2", "EXT4"):
                raise ExportError(f"one of its pickles has {opcode.name}")
    except ValueError as error:
        raise ExportError(f"one of its pickles cannot be read: {error}") from None


class _Inert:
    """What stands for everything that a pickle makes."""

    def __init__(self, *arguments: object) -> None:
        """Takes anything and keeps nothing."""

    def __setstate__(self, state: object) -> None:
        """Keeps nothing."""


class _Storages(pickle.Unpickler):
    """Reads the storages that a pickle names, and makes nothing of what it says.

    Each time that it names one, its size is compared: torch takes the first one's, whatever follows.

    Args:
        name: Of the pickle, without its suffix; its tensors are in the folder of that name.
        entries: All entries of the archive.
    """

    def __init__(self, name: str, entries: dict[str, bytes]) -> None:
        super().__init__(io.BytesIO(entries.get(f"{name}.pkl", pickle.dumps(None))))
        self._name, self._entries = name, entries

    def find_class(self, module: str, name: str) -> Any:
        """A storage's name, a dict for an ordered one, or what is inert."""
        if module == "torch":
            return name
        return dict if (module, name) == ("collections", "OrderedDict") else _Inert

    def persistent_load(self, pid: Any) -> _Inert:
        """Refuses a storage that is longer or shorter than its entry, by an ExportError."""
        _, kind, key, _, count = pid
        entry, size = f"{self._name}/{key}", _ITEM_BYTES[kind] * int(count)
        found = len(self._entries.get(entry, b""))
        if found != size:
            raise ExportError(f"its tensor {entry} has {found} bytes in place of {size}")
        return _Inert()


def _check_storages(name: str, entries: dict[str, bytes]) -> None:
    """Refuses a pickle whose tensors are longer than their entries: torch would read what is behind them."""
    try:
        _Storages(name, entries).load()
    except ExportError:
        raise
    except Exception as error:  # what was changed in it makes the unpickler raise nearly anything
        raise ExportError(f"its {name}.pkl cannot be read: {type(error).__name__}") from None


def _joined(argument: str) -> str:
    """A class of TorchScript as one dotted name; others as pickletools gives them, with a space."""
    return argument.replace(" ", ".") if argument.startswith("__torch__") else argument


def _check_code(data: bytes) -> None:
    if len(data) > LARGEST_CODE_BYTES:
        raise ExportError(f"its code has {len(data)} bytes, more than {LARGEST_CODE_BYTES}")
    try:
        tree = ast.parse(data.decode("utf-8"))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ExportError(f"its code cannot be read: {error}") from None
    for node in ast.walk(tree):
        if not isinstance(node, _NODES):
            raise ExportError(f"its code has {type(node).__name__!r}, which exports of this package do not have")
        if isinstance(node, ast.FunctionDef) and (node.name != "forward" or node.decorator_list):
            raise ExportError(f"its code has the function {node.name!r} besides forward")
        if isinstance(node, ast.Call):
            _check_call(ast.unparse(node.func))


def _check_call(function: str) -> None:
    path = function.split(".")
    allowed = (
        (len(path) == 2 and path[0] == "torch" and path[1] in OPERATORS)
        or (len(path) == 3 and path[:2] == ["ops", "prim"] and path[2] in PRIMITIVES)
        or (len(path) == 1 and path[0] in BUILT_INS)
        # A named tuple of the file's own, such as `Depths`.
        or (path[0] == "__torch__" and path[1:2] != ["torch"])
    )
    if not allowed:
        raise ExportError(f"its code calls {function[:80]!r}, which can do more than compute")


def _kinds(graph: Any) -> Iterator[str]:
    """Kinds of all nodes of a graph, and of the blocks within."""
    for node in graph.nodes():
        yield node.kind()
        for block in node.blocks():
            yield from _kinds(block)
