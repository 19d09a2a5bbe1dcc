"""The networks by name. Registering a network makes it available everywhere: the contract tests run over all names."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeVar

from radcam_depth_ros import configuration
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.interface import Network

NetworkT = TypeVar("NetworkT", bound=type[Network])

_NETWORKS: dict[str, type[Network]] = {}


class ArchitectureError(RadcamDepthError):
    """A network's name or architecture that cannot be built."""


class Common(Protocol):
    """What the config of every network has."""

    @property
    def threshold(self) -> float:
        """tau, from which on there is a semi-dense depth."""

    @property
    def min_depth_m(self) -> float:
        """Nearest depth that the network gives."""

    @property
    def max_depth_m(self) -> float:
        """Farthest depth that the network gives."""

    @property
    def focal_length_px(self) -> float:
        """The focal length that it is trained at."""


def check(config: Common) -> None:
    """Refuses what no network can have, by an ArchitectureError."""
    if not 0 < config.threshold < 1:
        raise ArchitectureError(f"threshold must lie between 0 and 1, got {config.threshold}")
    if not 0 < config.min_depth_m < config.max_depth_m:
        raise ArchitectureError(
            f"the depth range must be 0 < min < max metres, got {config.min_depth_m} to {config.max_depth_m}"
        )
    if config.focal_length_px <= 0:
        raise ArchitectureError(f"focal_length_px must be positive, got {config.focal_length_px}")


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


def create_config(name: str, architecture: Mapping[str, Any] | None = None) -> Any:
    """Builds the config of a network, checked.

    Args:
        name: One of `names()`.
        architecture: Its values; those left out take their defaults.

    Raises:
        ArchitectureError: for an unknown name, or values that do not fit together.
        ConfigurationError: for an unknown key.
    """
    return configuration.build(find(name).config_type, architecture or {}, f"the architecture of {name}")


def create(name: str, architecture: Mapping[str, Any] | None = None) -> Network:
    """Builds a network with fresh weights; arguments and errors as `create_config`."""
    config = create_config(name, architecture)
    return _NETWORKS[name](config)
