"""Weight files as an attacker would make them, from a good export and good weights."""

from __future__ import annotations

import functools
import hashlib
import io
import json
import pickle
import random
import re
import struct
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
import yaml

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.networks.weights_io.archive import Archive, Card
from radcam_depth_ros.networks.weights_io.card import card_text

SMALLEST = {"channels": [8, 8, 8, 8], "blocks": [1, 1, 1, 1], "threshold": 0.01}
INTEGERS = (0, 1, 7, 8, 255, 2**16, 2**31 - 1, 2**32 - 1, 2**33, 2**40, 2**63 - 1, 2**63, 2**64 - 1)


@dataclass(frozen=True)
class GoodFiles:
    """What hostile files are made from.

    Attributes:
        export: A TorchScript export.
        weights: A safetensors file.
    """

    export: bytes
    weights: bytes

    @functools.cached_property
    def entries(self) -> dict[str, bytes]:
        """The export's entries."""
        with zipfile.ZipFile(io.BytesIO(self.export)) as file:
            return {entry.filename: file.read(entry) for entry in file.infolist()}

    @functools.cached_property
    def code(self) -> str:
        """The name of one of the export's entries of code."""
        return next(name for name in self.entries if name.endswith(".py"))

    @functools.cached_property
    def header(self) -> dict[str, Any]:
        """The safetensors file's header."""
        return dict(json.loads(self.weights[8 : 8 + int.from_bytes(self.weights[:8], "little")]))

    @property
    def data(self) -> bytes:
        """The safetensors file's tensors."""
        return self.weights[8 + int.from_bytes(self.weights[:8], "little") :]

    @property
    def card(self) -> dict[str, Any]:
        """The card as a mapping."""
        return dict(yaml.safe_load(self.header["__metadata__"]["card"]))


@dataclass(frozen=True)
class Hostile:
    """A hostile file.

    Attributes:
        what: What was done.
        content: Its bytes.
        suffix: Of its name.
        may_load: Whether it may be read, for what was changed may be nothing that counts.
        must_equal: Whether it then gives what the good one gives.
        beside: Other files, by name.
    """

    what: str
    content: bytes
    suffix: str = ".pt"
    may_load: bool = False
    must_equal: bool = True
    beside: tuple[tuple[str, bytes], ...] = ()


def write_good(folder: Path) -> GoodFiles:
    """Writes `good.pt` and `good.safetensors`, the smallest network there is, where they are not there yet."""
    weights, export = folder / "good.safetensors", folder / "good.pt"
    if not export.exists():
        _write_good(weights, export)
    return GoodFiles(export.read_bytes(), weights.read_bytes())


def _write_good(weights: Path, export: Path) -> None:
    torch.manual_seed(0)
    network = networks.create("baff", SMALLEST).eval()
    with torch.no_grad():
        network.get_parameter("association.point_head.bias").add_(3.0)  # returns win pixels
    card = Card.of(network, "baff", "nothing")
    archive.save(network, card, weights)
    torchscript.export(Archive(network, card), export)


def hostile_file(rng: random.Random, good: GoodFiles) -> Hostile:
    """A hostile file of any kind."""
    return rng.choice(_MAKERS)(rng, good)


def packed(files: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    """An archive of entries."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", compression) as file:
        for name, data in files.items():
            file.writestr(name, data)
    return content.getvalue()


def mutated(rng: random.Random, content: bytes, start: int = 0) -> tuple[str, bytes]:
    """Bytes changed, cut off, filled or put elsewhere, from a place on."""
    how = rng.choice(("flipped", "flipped", "truncated", "lengthened", "zeroed", "moved", "numbers"))
    changed, place = bytearray(content), rng.randrange(start, max(len(content), start + 1))
    size = min(rng.choice((1, 4, 100, 5000)), len(content) - place)
    if how == "flipped":
        for _ in range(rng.choice((1, 1, 3, 20))):
            changed[rng.randrange(start, len(content))] ^= 1 << rng.randrange(8)
    elif how == "truncated":
        del changed[place:]
    elif how == "lengthened":
        changed[place:place] = rng.randbytes(rng.randint(1, 3000))
    elif how == "zeroed":
        changed[place : place + size] = bytes(size)
    elif how == "moved":
        other = rng.randrange(start, len(content) - size + 1)
        changed[place : place + size] = content[other : other + size]
    else:
        number = rng.choice(INTEGERS).to_bytes(8, "little")[: rng.choice((2, 4, 8))]
        changed[place : place + len(number)] = number
    return how, bytes(changed)


# Exports.


def _mutated_export(rng: random.Random, good: GoodFiles) -> Hostile:
    how, content = mutated(rng, good.export)
    return Hostile(f"export: {how}", content, may_load=True)


def _headers(rng: random.Random, good: GoodFiles) -> Hostile:
    """Bytes of local headers, the directory or its end."""
    changed = bytearray(good.export)
    signature = rng.choice((b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"PK\x06\x06", b"PK\x06\x07"))
    places = [match.start() for match in re.finditer(re.escape(signature), good.export)]
    for place in rng.sample(places, min(len(places), rng.choice((1, 1, 3)))):
        at, size = place + rng.randrange(4, 46), rng.choice((1, 2, 4))
        number = rng.choice((*INTEGERS, rng.getrandbits(64))).to_bytes(8, "little")[:size]
        changed[at : at + size] = number[: max(len(changed) - at, 0)]
    return Hostile(f"export: headers {signature[2:].hex()}", bytes(changed), may_load=True)


def _names(rng: random.Random, good: GoodFiles) -> Hostile:
    """Entries under names of other case, of other folders, that lead elsewhere, or twice."""
    how = rng.choice(("case", "folder", "elsewhere", "twice", "added"))
    name, files = rng.choice(list(good.entries)), dict(good.entries)
    folder, _, rest = name.partition("/")
    if how == "case":
        changed = rng.choice((re.sub(r"\.py$", ".PY", good.code), good.code.upper(), f"{folder}/{rest.title()}"))
        files[changed] = files.pop(good.code) if rng.random() < 0.5 else b"def forward(self):\n  torch.save(1, 'a')\n"
    elif how == "folder":
        files[f"other/{rest}"] = files.pop(name)
    elif how == "elsewhere":
        files[f"{folder}/{rng.choice(('../../', '/', '//', 'code/../../', '.../', 'C:'))}{rest}"] = files.pop(name)
    elif how == "added":
        files[f"{folder}/{rng.choice(('__init__.py', 'extra/x', 'code/a.py', 'data/-1', '.', 'x' * 60_000))}"] = b"x"
    else:
        content = io.BytesIO()
        with warnings.catch_warnings(), zipfile.ZipFile(content, "w") as file:
            warnings.simplefilter("ignore")
            for key, data in (*files.items(), (name, files[name] + b" ")):
                file.writestr(key, data)
        return Hostile("export: names twice", content.getvalue())
    return Hostile(f"export: names {how}", packed(files))


_MODULES = ("torch", "ops.aten", "ops.image", "ops.prim", "self", "builtins")
_FUNCTIONS = ("save", "from_file", "write_file", "system", "eval", "load", "__class__", "hub", "rand")
_TEXTS = ("\\x00", "\N{DIGIT ONE}", chr(0xD800), "a" * 10**6)
_OTHERS = ("global x", "exec('1')", "(lambda: 1)()", "[y for y in x]", "yield x", "@x", "\x00", "\\", "import os")


def _many(rng: random.Random, most: int) -> int:
    return int(10 ** rng.randint(1, most))


_STATEMENTS: tuple[Callable[[random.Random], str], ...] = (
    lambda rng: f"y = {rng.choice(_MODULES)}.{rng.choice(_FUNCTIONS)}(x, 'a')",
    lambda rng: f"y = {'(' * (n := _many(rng, 5))}x{')' * n}",
    lambda rng: f"y = torch{'.a' * _many(rng, 5)}(x)",
    lambda rng: f"y = {'-' * _many(rng, 5)}1",
    lambda rng: f"y = f{'[0]' * _many(rng, 4)}(x)",
    lambda rng: f"y = {'1 + ' * _many(rng, 5)}1",
    lambda rng: f"y = torch.relu{'(x)' * _many(rng, 4)}",
    lambda rng: f"y = {'9' * _many(rng, 6)}",
    lambda rng: f"y = torch.zeros([{10 ** rng.randint(5, 18)}])",
    lambda rng: f"y = '{rng.choice(_TEXTS)}'",
    lambda rng: rng.choice(_OTHERS),
    lambda rng: "if True:\n" + "".join(f"{'  ' * (n + 2)}if True:\n" for n in range(rng.choice((50, 99, 2000)))),
)


def _code(rng: random.Random, good: GoodFiles) -> Hostile:
    """Code that does more than compute, or is hard to read."""
    number = rng.randrange(len(_STATEMENTS))
    line = _STATEMENTS[number](rng).encode("utf-8", errors="surrogatepass")
    body = b"class A(Module):\n  def forward(self, x: Tensor) -> Tensor:\n    " + line + b"\n    return x\n"
    if rng.random() < 0.5:
        files = {**good.entries, good.code.replace("__torch__/", "__torch__/foreign_"): body}
    else:
        first, _, others = good.entries[good.code].partition(b"    ")
        files = {**good.entries, good.code: first + b"    " + line + b"\n    " + others}
    # Code of a class that nothing asks for is not read by torch, and does nothing.
    return Hostile(f"export: statement {number}", packed(files), may_load=True, must_equal=False)


def _bomb(rng: random.Random, good: GoodFiles) -> Hostile:
    """A small file that becomes large, or claims to."""
    how = rng.choice(("zeros", "code", "many", "sizes", "overlapping"))
    files = dict(good.entries)
    folder = good.code.partition("/")[0]
    if how == "zeros":
        return Hostile("export: bomb of zeros", packed({**files, f"{folder}/constants/999": _zeros(64)}, 8))
    if how == "code":
        return Hostile("export: bomb of code", packed({**files, good.code: b"#" * 2**24}, 8))
    if how == "many":
        return Hostile("export: very many entries", packed({f"{folder}/constants/{n}": b"" for n in range(20_000)}))
    content = bytearray(packed(files, 8))
    for match in list(re.finditer(b"PK\x01\x02", content)):
        if how == "sizes":
            content[match.start() + 24 : match.start() + 28] = struct.pack("<I", rng.choice((2**31, 2**32 - 1)))
        else:
            content[match.start() + 42 : match.start() + 46] = bytes(4)
    return Hostile(f"export: bomb, {how}", bytes(content))


@functools.cache
def _zeros(mebibytes: int) -> bytes:
    return bytes(mebibytes * 2**20)


class _Foreign:
    def __reduce__(self) -> tuple[Any, ...]:
        return (print, ("obeyed",))


def _pickles(rng: random.Random, good: GoodFiles) -> Hostile:
    """Pickles that make what is no tensor, and damaged ones whose checksum is right."""
    name = rng.choice([name for name in good.entries if name.endswith(".pkl")])
    how = rng.choice(("foreign", "mutated", "mutated", "deep", "random", "constants"))
    if how == "foreign":
        data = pickle.dumps(_Foreign(), protocol=rng.choice((0, 2, 4)))
    elif how == "deep":
        data = b"\x80\x02" + b"(" * 10 ** rng.randint(2, 5) + b"l" * 10 ** rng.randint(1, 4) + b"."
    elif how == "random":
        data = b"\x80\x02" + rng.randbytes(rng.randint(0, 300)) + b"."
    elif how == "constants":
        name = rng.choice([name for name in good.entries if "/constants/" in name])
        data = good.entries[name][: rng.randint(0, 64)]
    else:
        data = mutated(rng, good.entries[name])[1]
    return Hostile(f"export: pickle {how}", packed({**good.entries, name: data}), may_load=True, must_equal=False)


# Cards.


def _card_texts(rng: random.Random, good: GoodFiles) -> str:
    card = good.card
    key = rng.choice(list(card))
    text = card_text(configuration_card(card))
    value = rng.choice(
        (
            *("9" * 5000, "2001-99-99", "0x" + "f" * 9000, "!!python/object/apply:os.system ['x']", "1e999", ".nan"),
            *("!!binary x", "!!timestamp '2001-13-45 99:99:99'", "!!int x", "!!float x", "!!set {a, b}", "!!bool 3"),
            *("&a [*a]", "[" * 90 + "]" * 90, "- " * 3000, "? " * 3000, "'" + "x" * 70_000, "\x1b[2J", "190:20:30"),
            *("{[a]: 1}", "{{a: 1}: 2}", "<<: 3", "|\n  x", "=", "~", "\ud800", "\x00", "1_000", "-1", "[]", "{}"),
        )
    )
    if rng.random() < 0.5:
        return re.sub(rf"(?m)^{key}:(?:.*\n(?:  .*\n)*)", lambda _: f"{key}: {value}\n", text)
    return rng.choice((value, f"? {value}\n: 1\n", f"{text}{value}: 1\n", f"{text}\n---\n{text}", f"%YAML 9.9\n{text}"))


def configuration_card(card: dict[str, Any]) -> Card:
    """A card of its mapping."""
    return Card(**card)


def _hostile_card(rng: random.Random, good: GoodFiles) -> Hostile:
    """A card that is no card, within weights, beside them, or within an export."""
    where = rng.choice(("inside", "inside", "beside", "export"))
    text = _card_texts(rng, good)
    what = f"card {where}: {text[:30]!r}" if len(text) < 40 else f"card {where}"
    # A surrogate alone is no text that a file could hold.
    content = text.encode("utf-8", errors="replace")
    if where == "export":
        name = next(name for name in good.entries if name.endswith("card.yaml"))
        return Hostile(what, packed({**good.entries, name: content}), may_load=True)
    if where == "beside":
        header = {name: entry for name, entry in good.header.items() if name != "__metadata__"}
        return Hostile(what, _laid_out(header, good.data), ".safetensors", True, beside=(("hostile.yaml", content),))
    return Hostile(what, _with_card(good.header, good.data, text), ".safetensors", may_load=True)


# Weights.


def _laid_out(header: Any, data: bytes) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode("utf-8", errors="surrogatepass")
    return struct.pack("<Q", len(text)) + text + data


def _with_card(header: dict[str, Any], data: bytes, card: str) -> bytes:
    return _laid_out({**header, "__metadata__": {"card": card}}, data)


def _signed(header: dict[str, Any], data: bytes, good: GoodFiles) -> bytes:
    """A file whose card has the right hash, so that what is behind that check is reached."""
    card = replace(configuration_card(good.card), sha256=hashlib.sha256(data).hexdigest())
    return _with_card(header, data, card_text(card))


def _mutated_weights(rng: random.Random, good: GoodFiles) -> Hostile:
    how, content = mutated(rng, good.weights)
    return Hostile(f"weights: {how}", content, ".safetensors", may_load=True)


def _length(rng: random.Random, good: GoodFiles) -> Hostile:
    """A header that is longer or shorter than it says."""
    size = rng.choice((*INTEGERS, len(good.weights), len(good.weights) - 8, rng.getrandbits(rng.randint(1, 64))))
    return Hostile("weights: length of the header", struct.pack("<Q", size) + good.weights[8:], ".safetensors")


def _header(rng: random.Random, good: GoodFiles) -> Hostile:
    """Entries of tensors that lie, with a hash that is right."""
    header = {name: dict(entry) for name, entry in good.header.items()}
    name = rng.choice([name for name in header if name != "__metadata__"])
    entry, what = header[name], rng.choice(("dtype", "shape", "data_offsets", "name", "missing", "values", "metadata"))
    number: Any = rng.choice((*INTEGERS, -1, 0.5, 1e30, True, None, "1", [], 10**40))
    data = good.data
    if what == "dtype":
        entry[what] = rng.choice(("F64", "BOOL", "I8", "F8_E5M2", "C64", "object", 3, None, "F16" * 1000))
    elif what == "shape":
        entry[what] = rng.choice(([number], [number] * 8, [*entry[what], 0], [*entry[what], 1], [1] * 5000, number, {}))
    elif what == "data_offsets":
        other = rng.choice([entry["data_offsets"] for key, entry in header.items() if key != "__metadata__"])
        first, last = entry[what]
        entry[what] = rng.choice((other, [first, number], [number, last], [last, first], [first], number, [0, 0]))
    elif what == "name":
        header[rng.choice(("", "\x1b[2J", "x" * 10_000, "a/../b", "\ud800", "[red]x"))] = header.pop(name)
    elif what == "missing":
        del header[name]
    elif what == "values":
        place = rng.randrange(0, len(data) - 4, 2)
        data = data[:place] + rng.choice((b"\x00\x7c", b"\x00\x7e", b"\xff\xff")) + data[place + 2 :]
    else:
        header["__metadata__"]["more"] = number
        return Hostile("weights: metadata", _laid_out(header, data), ".safetensors", may_load=True)
    return Hostile(f"weights: {what}", _signed(header, data, good), ".safetensors", may_load=True, must_equal=False)


def _json(rng: random.Random, good: GoodFiles) -> Hostile:
    """A header that is hard to read."""
    depth = 10 ** rng.randint(2, 6)
    text = rng.choice(
        (
            *(b"[" * depth, b'{"a":' * depth, b'{"a":' * depth + b"1" + b"}" * depth, b"[]", b"null", b"1" * depth),
            *(
                b'{"__metadata__": {"card": 3}}',
                b'{"__metadata__": []}',
                b"\xff" * 100,
                b'{"a":1e999}',
                b"",
                b" " * depth,
            ),
            *(b'{"__metadata__":{"card":"' + b"x" * depth + b'"}}', b'{"a":{"dtype":"F16"}}', b'{"a":"\\ud800"}'),
        )
    )
    return Hostile("weights: JSON", _laid_out(text, good.data), ".safetensors")


# ONNX, which the package does not read, with tensors in a file elsewhere.


def _field(number: int, content: bytes) -> bytes:
    """A field of a protobuf message, with a length."""
    size, length = len(content), b""
    while size > 127:
        length, size = length + bytes((size & 127 | 128,)), size >> 7
    return bytes((number << 3 | 2,)) + length + bytes((size,)) + content


def _onnx(rng: random.Random, good: GoodFiles) -> Hostile:
    """An ONNX model whose tensor is in another file: the bystander, a device, or a file beside it."""
    place = rng.choice(("../home/bystander.txt", "/dev/zero", "/etc/passwd", "weights.bin", "a\x00b", "../" * 1000))
    entry = _field(1, b"location") + _field(2, place.encode())
    tensor = b"\x08\x01\x10\x01" + _field(8, b"w") + _field(13, entry) + b"\x70\x01"
    graph = _field(1, _field(2, b"y") + _field(4, b"Identity")) + _field(2, b"g") + _field(5, tensor)
    content = b"\x08\x09" + _field(7, graph) + _field(8, b"\x10\x11")
    if rng.random() < 0.5:
        content = mutated(rng, content)[1]
    suffix = rng.choice((".onnx", ".pt", ".safetensors", ""))
    return Hostile("ONNX with external data", content, suffix, beside=(("weights.bin", bytes(64)),))


_MAKERS: tuple[Callable[[random.Random, GoodFiles], Hostile], ...] = (
    *(_mutated_export, _headers, _headers, _names, _code, _code, _bomb, _pickles, _pickles),
    *(_hostile_card, _hostile_card, _mutated_weights, _length, _header, _header, _header, _json, _onnx),
)
