"""Weights on disk: safetensors beside a card in YAML, or one TorchScript file with the card inside.

Weights are never a pickle. All that is on the card is checked on loading, and a mismatch is refused with a sentence.
This is the only module that touches torch.jit, which torch deprecates: its successor, torch.export, is tried in tests.
"""

import hashlib
import importlib.resources
import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import torch
import yaml
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from radcam_depth_ros import configuration
from radcam_depth_ros.files import whole
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.migration import migrated
from radcam_depth_ros.networks.weights_io.export_check import LARGEST_BYTES, LARGEST_CARD_BYTES, find_fault
from radcam_depth_ros.networks.weights_io.folding import folded

CARD_FORMAT = 1
CARD_ENTRY = "card.yaml"


class ArchiveError(RadcamDepthError):
    """A weight file that is missing, corrupt, foreign, or does not fit its card."""


@dataclass(frozen=True)
class Card:
    """What a weight file says of itself.

    Attributes:
        network: Its name in the registry.
        architecture: Values of the network's config.
        focal_length_px: The focal length that it was trained at.
        min_depth_m: Nearest depth that it gives.
        max_depth_m: Farthest depth that it gives.
        training_data: What it was trained on, in words.
        metrics: Measured figures, by name, in metres where they are distances.
        sha256: Of the weights; filled in by `save`.
        card_format: Version of this card's layout.
    """

    network: str
    architecture: dict[str, Any]
    focal_length_px: float
    min_depth_m: float
    max_depth_m: float
    training_data: str
    metrics: dict[str, float] = field(default_factory=dict)
    sha256: str = ""
    card_format: int = CARD_FORMAT

    @property
    def tells_classes(self) -> bool:
        """Whether the network gives a class image."""
        return registry.find(self.network).tells_classes(registry.create_config(self.network, self.architecture))

    @classmethod
    def of(cls, network: Network, name: str, training_data: str, metrics: Mapping[str, float] | None = None) -> "Card":
        """The card of a network as it stands."""
        config = network.config
        return cls(
            network=name,
            architecture=configuration.as_mapping(config),
            focal_length_px=config.focal_length_px,
            min_depth_m=config.min_depth_m,
            max_depth_m=config.max_depth_m,
            training_data=training_data,
            metrics=dict(metrics or {}),
        )


@dataclass(frozen=True)
class Archive:
    """A network that is ready to run, and its card; `network` is a `Network`, or a script module from an export."""

    network: nn.Module
    card: Card


def shipped(name: str) -> Path:
    """Where the package keeps a network's weights; the file may be missing."""
    return Path(str(importlib.resources.files("radcam_depth_ros"))) / "weights" / f"{name}.safetensors"


def load(source: Path | str) -> Archive:
    """Loads a network by name (its shipped weights) or by file (`.safetensors` with its card beside, or an export).

    Raises:
        ArchiveError: when anything is missing, corrupt or does not fit.
    """
    if str(source) in registry.names():
        path = shipped(str(source))
        if not path.exists():
            raise ArchiveError(
                f"no weights for {source!r} come with this package; train them with "
                f"`radcam-depth train --network {source}` and give their file"
            )
    else:
        path = Path(source)
    if not path.is_file():
        raise ArchiveError(
            f"no weight file at {path}; give a .safetensors file with its card, an exported .pt file, or a network's "
            f"name: {', '.join(registry.names())}"
        )
    return _load_weights(path) if path.suffix == ".safetensors" else _load_export(path)


def save(network: Network, card: Card, path: Path | str) -> Card:
    """Writes weights in half precision, statistics in single, and their card beside them: whole or not at all.

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
    with whole(target) as temporary:
        save_file(tensors, temporary)
        # safetensors makes files that only their owner can read; an installed package has other readers.
        temporary.chmod(0o644)
        written = Card(**{**card.__dict__, "sha256": _sha256(temporary)})
        with whole(target.with_suffix(".yaml")) as card_file:
            card_file.write_text(_card_text(written), encoding="utf-8")
    return written


def export(archive: Archive, path: Path | str) -> None:
    """Writes one self-contained TorchScript file, frozen, with the card inside; a C++ node can load it as well."""
    target = Path(path)
    module = freeze(archive.network)
    with whole(target) as temporary, _quiet_jit():
        torch.jit.save(module, str(temporary), _extra_files={CARD_ENTRY: _card_text(archive.card)})


def freeze(network: nn.Module, dtype: torch.dtype = torch.float32) -> torch.jit.ScriptModule:
    """Scripts a copy of a network with its batch norms and constants folded; the network itself stays as it is.

    Args:
        network: Any scriptable module; one that is frozen already, from an export, is returned as it is.
        dtype: Of its weights and maps, rounded after folding.
    """
    if isinstance(network, torch.jit.ScriptModule):
        return network
    # torch keeps all that it scripts until the process ends, and freezing writes the weights into it. What is read from
    # a file goes when nobody holds it, so both steps go by one. Reading again after freezing is for errors while the
    # network runs: torch looks for the code as it was before, and crashes where that is gone.
    with _quiet_jit():
        scripted = _reread(torch.jit.script(folded(network, dtype)))
        return _reread(torch.jit.freeze(scripted.eval()))


def _reread(module: torch.jit.ScriptModule) -> torch.jit.ScriptModule:
    content = io.BytesIO()
    torch.jit.save(module, content)
    content.seek(0)
    reread = torch.jit.load(content)  # type: ignore[no-untyped-call]  # torch leaves it without types
    return cast(torch.jit.ScriptModule, reread)


def _load_weights(path: Path) -> Archive:
    card_path = path.with_suffix(".yaml")
    if not card_path.is_file():
        raise ArchiveError(f"the weights {path} have no card; expected {card_path.name} beside them")
    for file, most in ((path, LARGEST_BYTES), (card_path, LARGEST_CARD_BYTES)):
        if file.stat().st_size > most:
            raise ArchiveError(f"expected at most {most} bytes in {file}, got {file.stat().st_size}; copy it again")
    card = _card(card_path.read_text(encoding="utf-8", errors="replace"), str(card_path))
    if _sha256(path) != card.sha256:
        raise ArchiveError(
            f"{path.name} is not the file that its card describes (sha256 differs): it is corrupt or was replaced; "
            "copy the weights and the card again"
        )
    try:
        tensors = load_file(path)
    except (SafetensorError, OSError) as error:
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


def _load_export(path: Path) -> Archive:
    fault = find_fault(path, CARD_ENTRY)
    if fault:
        raise ArchiveError(f"{path} is not read: {fault}; make it with `radcam-depth export`")
    extra = {CARD_ENTRY: ""}
    try:
        with _quiet_jit():
            module: nn.Module = torch.jit.load(  # type: ignore[no-untyped-call]  # torch leaves it without types
                str(path), map_location="cpu", _extra_files=extra
            )
    except (RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise ArchiveError(
            f"{path} is neither .safetensors nor a TorchScript file that can be read ({reason}); make one with "
            "`radcam-depth export`"
        ) from None
    text: str | bytes = extra[CARD_ENTRY]
    if not text:
        raise ArchiveError(f"{path} is a TorchScript file without a card; make it with `radcam-depth export`")
    card = _card(text.decode("utf-8") if isinstance(text, bytes) else text, str(path))
    return Archive(module, card)


def _card(text: str, source: str) -> Card:
    try:
        # Aliases would let a few lines stand for a billion values.
        has_aliases = any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text))
        mapping = None if has_aliases else yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError):
        mapping = None
    if not isinstance(mapping, dict):
        raise ArchiveError(f"{source} holds no card: expected a YAML mapping with network, architecture, sha256 ...")
    try:
        card = configuration.build(Card, mapping, source)
    except configuration.ConfigurationError as error:
        raise ArchiveError(f"the card does not fit: {error}") from None
    if card.card_format != CARD_FORMAT:
        raise ArchiveError(
            f"{source} is of card format {card.card_format}, this package reads {CARD_FORMAT}; update it"
        )
    network, architecture = migrated(card.network, card.architecture)
    card = replace(card, network=network, architecture=architecture)
    config = registry.create_config(network, architecture)
    for name in ("focal_length_px", "min_depth_m", "max_depth_m"):
        if getattr(config, name) != getattr(card, name):
            raise ArchiveError(
                f"{source} contradicts itself: {name} is {getattr(card, name)}, but {getattr(config, name)} in its "
                "architecture"
            )
    return card


def _card_text(card: Card) -> str:
    return yaml.safe_dump(configuration.as_mapping(card), sort_keys=False, width=100)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def _quiet_jit() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*torch.jit.*", category=DeprecationWarning)
        yield
