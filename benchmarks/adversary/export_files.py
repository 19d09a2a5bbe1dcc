"""Exports as an attacker would make them: names, headers, code, sizes and pickles."""

from __future__ import annotations

import functools
import io
import pickle
import random
import re
import struct
import warnings
import zipfile
from collections.abc import Callable
from typing import Any

from benchmarks.adversary.good_files import INTEGERS, GoodFiles, Hostile, mutated, packed


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


MAKERS: tuple[Callable[[random.Random, GoodFiles], Hostile], ...] = (
    *(_mutated_export, _headers, _headers, _names, _code, _code, _bomb, _pickles, _pickles),
)
