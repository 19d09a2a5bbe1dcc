"""Builds a trained network with other values of what no weight depends on."""

from __future__ import annotations

import dataclasses

from radcam_depth_ros import networks
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io.archive import Archive


def adjusted(loaded: Archive, **values: float) -> networks.Network:
    """The same weights, ready to run, with other values of its config: `threshold`, `caution`.

    Values that the network's config does not have are left out.
    """
    card = loaded.card
    known = {field.name for field in dataclasses.fields(registry.find(card.network).config_type)}
    changed = {name: value for name, value in values.items() if name in known}
    network = networks.create(card.network, {**card.architecture, **changed}).eval()
    network.load_state_dict(loaded.network.state_dict())
    return network
