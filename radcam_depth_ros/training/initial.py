"""Weights that a training starts from, and how much of them is kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from radcam_depth_ros import configuration, networks
from radcam_depth_ros.networks import archive
from radcam_depth_ros.training.samples import TrainingError


def load_initial(network: networks.Network, name: str, source: str | Path) -> None:
    """Gives a network the weights of an archive of the same architecture.

    Args:
        network: To be trained.
        name: Its name in the registry.
        source: A network's name, for the weights that come with the package, or a weight file.

    Raises:
        TrainingError: when they do not fit; it names the first entry that differs.
        ArchiveError: when they cannot be loaded.
    """
    given = archive.load(source)
    if isinstance(given.network, torch.jit.ScriptModule):
        raise TrainingError(f"{source} is an export, and an export cannot be trained; give the .safetensors file")
    if given.card.network != name:
        raise TrainingError(f"the weights of {source} are of {given.card.network!r}, not of {name!r}")
    mine, theirs = configuration.as_mapping(network.config), given.card.architecture
    for key, value in mine.items():
        # tau is no weight: it may be another one.
        if key != "threshold" and theirs.get(key) != value:
            raise TrainingError(
                f"the architecture of {source} differs: its {key} is {theirs.get(key)}, the recipe's is {value}; leave "
                f"{key} out of the recipe, or start from other weights"
            )
    network.load_state_dict(given.network.state_dict())


@torch.no_grad()
def blend(network: nn.Module, initial: Mapping[str, Tensor], share: float) -> None:
    """Moves a network's weights and statistics towards others, by `share` of the way.

    Between fine-tuned weights and those they came from lie weights that know both (WiSE-FT, Wortsman et al. 2022).
    """
    for name, value in network.state_dict().items():
        if value.is_floating_point():
            value.lerp_(initial[name].to(value), share)
