"""Weight files as an attacker would make them: cards, safetensors, ONNX; and exports, see `export_files`."""

from __future__ import annotations

import hashlib
import json
import random
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import yaml

from benchmarks.adversary import export_files
from benchmarks.adversary.good_files import INTEGERS, GoodFiles, Hostile, mutated, packed
from radcam_depth_ros.networks.weights_io import onnx_file
from radcam_depth_ros.networks.weights_io.archive import Card
from radcam_depth_ros.networks.weights_io.card import card_text


def hostile_file(rng: random.Random, good: GoodFiles) -> Hostile:
    """A hostile file of any kind."""
    return rng.choice(_MAKERS)(rng, good)


# Cards.


def _card_texts(rng: random.Random, good: GoodFiles) -> str:
    card = good.card
    key = rng.choice(list(card))
    text = card_text(_card(card))
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


def _card(card: dict[str, Any]) -> Card:
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
    card = replace(_card(good.card), sha256=hashlib.sha256(data).hexdigest())
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


# ONNX with tensors in a file elsewhere, with and without the card and the SHA-256 of an export.


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
    if rng.random() < 0.5:
        card = _field(1, onnx_file.CARD_KEY.encode()) + _field(2, yaml.safe_dump(good.card).encode())
        content = onnx_file.seal(content + _field(14, card))
    suffix = rng.choice((".onnx", ".pt", ".safetensors", ""))
    return Hostile("ONNX with external data", content, suffix, beside=(("weights.bin", bytes(64)),))


_MAKERS: tuple[Callable[[random.Random, GoodFiles], Hostile], ...] = (
    *export_files.MAKERS,
    *(_hostile_card, _hostile_card, _mutated_weights, _length, _header, _header, _header, _json, _onnx),
)
