"""Good weight files, which hostile ones are made from."""

from __future__ import annotations

import functools
import io
import json
import random
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import yaml

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive, torchscript
from radcam_depth_ros.networks.weights_io.archive import Archive, Card

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
