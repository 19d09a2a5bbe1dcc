"""Reads architectures that earlier versions wrote: renamed and removed keys, and forms that are networks now."""

import warnings
from collections.abc import Mapping
from typing import Any

RENAMED = {"considered": "returns_per_cell"}
"""Keys of `baff` and `baseline` that have another name now."""

FORM_KEY = "fusion"
"""Key of `baff` and `baseline` that chose between two forms: `quarter`, the only one left, and `paper`."""

NOT_IN_PAPER = (
    "association",
    "blocks",
    "caution",
    "channels",
    "considered",
    "context",
    "detail",
    "embedding_dims",
    "familiar",
    "fusion",
    "ground_prior",
    "instance_norm",
    "road",
)
"""Keys that the form `paper` had and did not use; `baff_paper` lacks them."""


class ArchitectureWarning(UserWarning):
    """An architecture of an earlier version, read as what it is called now."""


def migrated(network: str, architecture: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The name and architecture of a network as this version has them.

    Warns with an `ArchitectureWarning` where they differ, in one sentence that says what changed.

    Args:
        network: Name of the network.
        architecture: Values of its config.
    """
    values = dict(architecture)
    if network not in ("baff", "baseline"):
        return network, values
    changes = []
    form = values.get(FORM_KEY)
    if form == "paper":
        changes.append(f"{network} with fusion: paper is the network baff_paper now")
        network, values = "baff_paper", {key: value for key, value in values.items() if key not in NOT_IN_PAPER}
    elif form == "quarter":
        changes.append("fusion: quarter is the only form now and its key is gone")
        del values[FORM_KEY]
    for old, new in RENAMED.items():
        if old in values:
            changes.append(f"{old} is called {new} now")
            values[new] = values.pop(old)
    if changes:
        warnings.warn(
            f"the architecture of {network} is of an earlier version: {'; '.join(changes)}",
            ArchitectureWarning,
            stacklevel=3,
        )
    return network, values


_FORMER: Mapping[str, Any] = {
    "geometry_mix": False,
    "full_size": False,
    "hint": False,
    "context": "none",
    "familiar": 0.0,
}

_WITHOUT: Mapping[str, Mapping[str, Any]] = {
    "baff": _FORMER,
    "baseline": _FORMER,
    "lircdepth": {"sky": False, "familiar": 0.0},
    "structured": {"familiar": 0.0},
    "cafnet": {"sky": False},
}
"""Values of keys that the cards of earlier versions lack."""


def completed(network: str, architecture: Mapping[str, Any]) -> dict[str, Any]:
    """The architecture of a card with the keys that its version did not have, so that its depth stays as it was."""
    return {**_WITHOUT.get(network, {}), **architecture}
