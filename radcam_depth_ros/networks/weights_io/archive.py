"""Reads and writes weights as safetensors with a card in YAML inside, never as a pickle.

All that is on the card is checked on loading, and a mismatch is refused with a sentence.
"""

import hashlib
import importlib.resources
import importlib.util
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from radcam_depth_ros import __version__
from radcam_depth_ros.files import whole, write_text
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.weights_io import onnx_file, torchscript
from radcam_depth_ros.networks.weights_io.card import Archive, ArchiveError, Card, card_text, read_card
from radcam_depth_ros.networks.weights_io.export_check import LARGEST_BYTES, LARGEST_CARD_BYTES

__all__ = ["Archive", "ArchiveError", "Card", "how_to_get", "load", "save", "shipped"]


CARD_KEY = "card"
"""Key of the card, as YAML, in a safetensors file's metadata."""
LARGEST_HEADER_BYTES = 16 * 1024**2
MORE_WEIGHTS = "radcam-depth-weights"
"""Wheel with the weights of all networks but the default one (docs/release.md)."""


def shipped(name: str) -> Path:
    """Where a network's weights are: in this package, or else in the wheel `MORE_WEIGHTS`; the file may be missing."""
    own = Path(str(importlib.resources.files("radcam_depth_ros"))) / "weights" / f"{name}.safetensors"
    if own.is_file():
        return own
    wheel = importlib.util.find_spec(MORE_WEIGHTS.replace("-", "_"))
    folders = wheel.submodule_search_locations if wheel else None
    return next((path for folder in folders or () if (path := Path(folder, own.name)).is_file()), own)


def how_to_get(name: str) -> str:
    """What to do where a network's weights are missing: a wheel's package has all cards, but not all weights."""
    if shipped(name).with_suffix(".yaml").is_file():
        return f"they are in the wheel {MORE_WEIGHTS}: pip install {MORE_WEIGHTS}=={__version__}"
    return f"none come with this package: radcam-depth train --network {name} --bags drives/ --out runs/{name}"


def load(source: Path | str, *, allow_exported: bool = True, trusted: Sequence[str] = ()) -> Archive:
    """Loads a network by name (its shipped weights) or by file (`.safetensors`, or an export).

    Args:
        source: A network's name, or a file.
        allow_exported: Whether it may be an export, which has code or operators of its own.
        trusted: SHA-256 of the weight files that may be loaded; any when there are none.

    Raises:
        ArchiveError: when anything is missing, corrupt or does not fit.
    """
    if str(source) in registry.names():
        path = shipped(str(source))
        if not path.exists():
            raise ArchiveError(f"the weights of {source!r} are not installed; {how_to_get(str(source))}")
    else:
        path = Path(source)
    if not path.is_file():
        raise ArchiveError(
            f"no weight file at {path}; give a .safetensors file with its card, an exported .pt or .onnx file, or a "
            f"network's name: {', '.join(registry.names())}"
        )
    is_exported = path.suffix != ".safetensors"
    if is_exported and not allow_exported:
        raise ArchiveError(
            f"{path} is no .safetensors file: an exported file has code that would run here, and allow_exported is "
            "false; give the .safetensors file, or set the parameter allow_exported to true for a file of your own"
        )
    content = _read(path)
    found = hashlib.sha256(content).hexdigest()
    if trusted and found not in {entry.lower() for entry in trusted}:
        raise ArchiveError(
            f"{path} is not among trusted_models: its SHA-256 is {found}; add it to that parameter if you know where "
            "the file is from"
        )
    if path.suffix.lower() == ".onnx":
        loaded = onnx_file.load(path, content)
    else:
        loaded = torchscript.load(path, content) if is_exported else _load_weights(path, content, found)
    return replace(loaded, file_sha256=found)


def _read(path: Path) -> bytes:
    """A file's bytes, read once: what is checked is what is loaded."""
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        raise ArchiveError(f"expected at most {LARGEST_BYTES} bytes in {path}, got {size}; copy it again")
    return path.read_bytes()


def save(network: Network, card: Card, path: Path | str) -> Card:
    """Writes weights in half precision, statistics in single, with their card inside: whole or not at all.

    The same card stands beside them as YAML, for people: what is loaded is the one inside.

    Args:
        network: The network.
        card: Its card; `sha256` is filled in.
        path: Ends in `.safetensors`.

    Returns:
        The card as written.
    """
    target = Path(path)
    if target.suffix != ".safetensors":
        raise ArchiveError(f"weights are written as .safetensors, got {target.name}")
    # The statistics of batch norms stay in single precision: a variance can be more than a half holds.
    weights = {name for name, _ in network.named_parameters()}
    tensors = {
        name: (value.half() if name in weights else value).contiguous().cpu()
        for name, value in network.state_dict().items()
    }
    for name, value in tensors.items():
        if not torch.isfinite(value.float()).all():
            raise ArchiveError(f"{name} is not finite in half precision; nothing was written, train on or start again")
    bare = save_tensors(tensors)
    written = replace(card, sha256=hashlib.sha256(_data(bare)).hexdigest())
    text = card_text(written)
    content = save_tensors(tensors, {CARD_KEY: text})
    with whole(target) as temporary:
        temporary.write_bytes(content)
    write_text(target.with_suffix(".yaml"), text)
    return written


def _data(content: bytes) -> memoryview:
    """The tensors' bytes of a safetensors file, behind its header; empty where it is none."""
    return memoryview(content)[8 + int.from_bytes(content[:8], "little") :]


def _card_inside(content: bytes) -> str:
    """The card in a safetensors file's header; empty in files of earlier versions, and in what is none."""
    size = int.from_bytes(content[:8], "little")
    if len(content) < 8 or not 0 < size <= min(len(content) - 8, LARGEST_HEADER_BYTES):
        return ""
    try:
        header = json.loads(content[8 : 8 + size])
        text = header["__metadata__"][CARD_KEY]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ""
    return text if isinstance(text, str) else ""


def _card_beside(path: Path) -> str:
    card_path = path.with_suffix(".yaml")
    if not card_path.is_file():
        raise ArchiveError(f"the weights {path} have no card inside; expected {card_path.name} beside them")
    size = card_path.stat().st_size
    if size > LARGEST_CARD_BYTES:
        raise ArchiveError(f"expected at most {LARGEST_CARD_BYTES} bytes in {card_path}, got {size}; copy it again")
    return card_path.read_text(encoding="utf-8", errors="replace")


def _load_weights(path: Path, content: bytes, sha256: str) -> Archive:
    inside = _card_inside(content)
    if len(inside) > LARGEST_CARD_BYTES:
        raise ArchiveError(f"expected a card of at most {LARGEST_CARD_BYTES} bytes in {path}, got {len(inside)}")
    card = read_card(inside or _card_beside(path), str(path if inside else path.with_suffix(".yaml")))
    # A card inside tells the tensors' hash, one beside that of the whole file.
    if inside:
        sha256 = hashlib.sha256(_data(content)).hexdigest()
    if sha256 != card.sha256:
        raise ArchiveError(
            f"{path.name} is not the file that its card describes (sha256 differs): it is corrupt or was replaced; "
            "copy it again, with the card beside it"
        )
    try:
        tensors = load_tensors(content)
    except (SafetensorError, ValueError) as error:
        raise ArchiveError(f"{path} is not a readable safetensors file: {error}") from None
    with torch.device("meta"):  # without memory: a card may name any number of channels
        _check_tensors(registry.create(card.network, card.architecture), tensors, path)
    network = registry.create(card.network, card.architecture)
    network.load_state_dict({name: value.float() for name, value in tensors.items()})
    return Archive(network.eval(), card)


def _check_tensors(network: Network, tensors: Mapping[str, Tensor], path: Path) -> None:
    expected = network.state_dict()
    for name in sorted({*expected, *tensors}):
        if name not in tensors or name not in expected:
            whose = "lacks" if name not in tensors else "has, besides what the network needs,"
            raise ArchiveError(f"{path.name} does not fit its architecture: it {whose} the tensor {name}")
        if expected[name].shape != tensors[name].shape:
            raise ArchiveError(
                f"{path.name} does not fit its architecture: {name} should be {tuple(expected[name].shape)}, "
                f"got {tuple(tensors[name].shape)}"
            )
        if not torch.isfinite(tensors[name].float()).all():
            raise ArchiveError(f"{path.name} holds values that are not finite in {name}; train or copy it again")
