"""Finds networks by name. A registered network is available to every command, and the contract tests run over all."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from radcam_depth_ros import configuration
from radcam_depth_ros.networks.config import ArchitectureError
from radcam_depth_ros.networks.interface import Network
from radcam_depth_ros.networks.migration import migrated

NetworkT = TypeVar("NetworkT", bound=type[Network])

_NETWORKS: dict[str, type[Network]] = {}


def register(name: str) -> Callable[[NetworkT], NetworkT]:
    """Class decorator that makes a network available under a name."""

    def add(network: NetworkT) -> NetworkT:
        _NETWORKS[name] = network
        return network

    return add


def names() -> tuple[str, ...]:
    """Names of all networks, sorted."""
    return tuple(sorted(_NETWORKS))


def find(name: str) -> type[Network]:
    """The class of a network; ArchitectureError for an unknown name."""
    if name not in _NETWORKS:
        raise ArchitectureError(f"unknown network {name!r}; known networks: {', '.join(names())}")
    return _NETWORKS[name]


def trained_as(name: str) -> str:
    """Name of the losses and the recipe that a network is trained by: its own, unless its class names others."""
    network = _NETWORKS.get(name)
    return network.trained_like or name if network else name


def create_config(name: str, architecture: Mapping[str, Any] | None = None) -> Any:
    """Builds the config of a network, checked.

    Args:
        name: One of `names()`.
        architecture: Its values; those left out take their defaults. Keys of earlier versions are read, with a warning.

    Raises:
        ArchitectureError: for an unknown name, or values that do not fit together.
        ConfigurationError: for an unknown key.
    """
    config_type = find(name).config_type
    network, values = migrated(name, architecture or {})
    if network != name:
        raise ArchitectureError(f"this form of {name} is a network of its own now; name {network} instead")
    return configuration.build(config_type, values, f"the architecture of {name}")


def create(name: str, architecture: Mapping[str, Any] | None = None) -> Network:
    """Builds a network with fresh weights; arguments and errors as `create_config`."""
    config = create_config(name, architecture)
    return _NETWORKS[name](config)
