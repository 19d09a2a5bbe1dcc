"""The card of a weight file: network, architecture, training and metrics, as YAML that is checked on reading."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import yaml
from torch import nn

from radcam_depth_ros import configuration
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.migration import completed, migrated

CARD_FORMAT = 1
MOST_BRACKETS = 100
"""Lists and mappings in brackets: thousands within one another would take seconds to read."""


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
    """A network that is ready to run, and its card.

    Attributes:
        network: A `Network`, or what an export is read as: a script module or an `OnnxNetwork`.
        card: Its card.
        file_sha256: SHA-256 of the file that it was read from, in hexadecimal digits; empty for a network of no file.
    """

    network: nn.Module
    card: Card
    file_sha256: str = ""

    @property
    def is_export(self) -> bool:
        """Whether it was read from an exported file, which can be run and nothing else."""
        return not isinstance(self.network, Network)


def read_card(text: str, source: str) -> Card:
    """Reads a card, of an earlier version too; ArchiveError where it does not fit."""
    if max((text.count(bracket) for bracket in "[{"), default=0) > MOST_BRACKETS:
        raise ArchiveError(f"{source} holds no card: it has more than {MOST_BRACKETS} lists or mappings in brackets")
    try:
        # Aliases would let a few lines stand for a billion values.
        has_aliases = any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text))
        mapping = None if has_aliases else yaml.safe_load(text)
        repr(mapping)  # a number of 5000 digits in hexadecimal is read, and can be shown in no sentence
    except Exception:  # a date in month 99, a number of 5000 digits: the parser raises nearly anything
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
    card = replace(card, network=network, architecture=completed(network, architecture))
    config = registry.create_config(network, card.architecture)
    for name in ("focal_length_px", "min_depth_m", "max_depth_m"):
        if getattr(config, name) != getattr(card, name):
            raise ArchiveError(
                f"{source} contradicts itself: {name} is {getattr(card, name)}, but {getattr(config, name)} in its "
                "architecture"
            )
    return card


def card_text(card: Card) -> str:
    """The card as YAML."""
    return yaml.safe_dump(configuration.as_mapping(card), sort_keys=False, width=100)
