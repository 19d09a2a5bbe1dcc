"""The subject of a measurement: a network, how it is run, and its inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from radcam_depth_ros.engine import MODES, PRECISIONS, RUNTIMES, Engine
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.geometry import NETWORK_MULTIPLE
from radcam_depth_ros.networks import Depths, Network, registry
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.networks.weights_io.archive import Archive, Card

CAMERA_HEIGHT_M = 1.5


class BenchmarkError(RadcamDepthError):
    """A measurement that cannot be made as it was asked for."""


@dataclass(frozen=True)
class Size:
    """What a network is given.

    Attributes:
        height: Rows of the image as the network sees it, a multiple of 32.
        width: Columns, a multiple of 32.
        points: Number of radar returns.
    """

    height: int
    width: int
    points: int

    def __post_init__(self) -> None:
        if min(self.height, self.width) < 1 or self.height % NETWORK_MULTIPLE or self.width % NETWORK_MULTIPLE:
            raise BenchmarkError(
                f"a network's image must have sides that are multiples of {NETWORK_MULTIPLE}, got "
                f"{self.height} x {self.width}"
            )
        if self.points < 0:
            raise BenchmarkError(f"the number of radar points must not be negative, got {self.points}")

    def __str__(self) -> str:
        return f"{self.height} x {self.width}, {self.points} points"

    @classmethod
    def padded(cls, height: int, width: int, points: int) -> Size:
        """The size with both sides rounded up to multiples of 32, as the estimator pads them."""
        rows, columns = (-(-side // NETWORK_MULTIPLE) * NETWORK_MULTIPLE for side in (height, width))
        return cls(rows, columns, points)


@dataclass(frozen=True)
class Subject:
    """A network and how it is run.

    Attributes:
        network: Its name in the registry.
        model_file: A weight file in place of `network`; empty for the shipped weights.
        architecture: Values of its config that differ from those of the weights.
        precision: `auto`, `float32` or `bfloat16`, as the engine takes it.
        mode: `frozen` or `eager`, as the engine takes it.
        device: `cpu`, or `cuda` and so on.
        runtime: What onnxruntime runs an ONNX file on, as the engine takes it.
        threads: CPU threads; 0 as the engine takes it.
    """

    network: str = "baff"
    model_file: str = ""
    architecture: Mapping[str, Any] = field(default_factory=dict)
    precision: str = "auto"
    mode: str = "frozen"
    device: str = "cpu"
    runtime: str = "auto"
    threads: int = 0

    def __post_init__(self) -> None:
        choices = (
            ("precision", self.precision, PRECISIONS),
            ("mode", self.mode, MODES),
            ("runtime", self.runtime, RUNTIMES),
        )
        for name, value, known in choices:
            if value not in known:
                raise BenchmarkError(f"{name} must be one of {', '.join(known)}, got {value!r}")
        if self.threads < 0:
            raise BenchmarkError(f"threads must be 0 (as many as are free) or more, got {self.threads}")

    def load(self) -> Loaded:
        """Loads the network, with the weights that fit its architecture, or random ones where there are none.

        Raises:
            ArchiveError: when `model_file` cannot be read.
            ArchitectureError: for an unknown network or an architecture that cannot be.
            ConfigurationError: for an unknown key of the architecture.
        """
        if self.threads:
            torch.set_num_threads(self.threads)
        try:
            found = archive.load(self.model_file or self.network)
        except RadcamDepthError as error:
            # Time does not depend on weights: an architecture that is being worked on, whose weights are not there yet
            # or are of an earlier form, can be measured all the same.
            if self.model_file or self.network not in registry.names():
                raise
            return self._with_random_weights(self.network, self.architecture, f": {error}")
        name, values = found.card.network, {**found.card.architecture, **self.architecture}
        if registry.create_config(name, values) == registry.create_config(name, found.card.architecture):
            return Loaded(found, self.model_file or "shipped")
        return self._with_random_weights(name, values)

    @staticmethod
    def _with_random_weights(name: str, architecture: Mapping[str, Any], reason: str = "") -> Loaded:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            network = registry.create(name, architecture).eval()
        return Loaded(Archive(network, Card.of(network, name, "nothing")), f"random{reason}")


@dataclass(frozen=True)
class Loaded:
    """A subject's network.

    Attributes:
        archive: The network and its card.
        weights: `shipped`, the file that they came from, or `random` and, after a colon, why there are no shipped ones
            that fit.
    """

    archive: Archive
    weights: str

    @property
    def network(self) -> nn.Module:
        """The network, in evaluation mode."""
        return self.archive.network

    @property
    def sections(self) -> tuple[tuple[str, str], ...]:
        """Names and paths of the sections that this architecture has; none for an export, which is one piece."""
        if not isinstance(self.network, Network):
            return ()
        paths = {path for path, module in self.network.named_modules() if not isinstance(module, nn.Identity)}
        return tuple((name, path) for name, path in self.network.sections if path in paths)


@dataclass(frozen=True)
class Running:
    """A subject that is loaded and ready to run.

    Attributes:
        subject: How it was asked for.
        loaded: Its network.
        engine: What runs it.
    """

    subject: Subject
    loaded: Loaded
    engine: Engine

    @classmethod
    def start(cls, subject: Subject) -> Running:
        """Loads a subject; errors as `Subject.load`."""
        loaded = subject.load()
        engine = Engine(
            loaded.network, subject.device, subject.precision, subject.mode, subject.threads, subject.runtime
        )
        return cls(subject, loaded, engine)

    @property
    def resolved(self) -> Subject:
        """The subject with the precision that the engine chose, so that it need not be measured again."""
        return replace(self.subject, precision=self.engine.precision)

    @property
    def focal_length_px(self) -> float:
        """The network's focal length."""
        return self.loaded.archive.card.focal_length_px

    def estimator(self) -> Estimator:
        """An estimator with the same network and precision."""
        subject = self.resolved
        config = EstimatorConfig(device=subject.device, precision=subject.precision, runtime=subject.runtime)
        return Estimator(config, self.loaded.archive)

    def prepare(self, size: Size) -> tuple[NetworkInputs, Callable[[], Depths]]:
        """What the network is given at a size, and a call that runs it, warmed up where it is frozen."""
        inputs = NetworkInputs.synthetic(size, self.focal_length_px)
        call = partial(self.engine.run, *inputs.as_tuple())
        if self.subject.mode == "frozen":
            self.engine.warm_up(size.height, size.width)
            call()
        return inputs, call


@dataclass(frozen=True)
class NetworkInputs:
    """What an engine is given for a frame.

    Attributes:
        image: (H, W, 3) uint8.
        radar: (N, 6) float32, columns of `networks.RADAR_COLUMNS`.
        ground: (4,) float32, the flat road's inverse depth.
    """

    image: Tensor
    radar: Tensor
    ground: Tensor

    def as_tuple(self) -> tuple[Tensor, Tensor, Tensor]:
        """In the order that an engine takes them."""
        return self.image, self.radar, self.ground

    @classmethod
    def synthetic(cls, size: Size, focal_length_px: float) -> NetworkInputs:
        """A made-up street: sky over a grey road, some noise, returns all over the image; always the same."""
        generator = torch.Generator().manual_seed(0)
        horizon = 0.45 * size.height
        rows = torch.arange(size.height, dtype=torch.float32).reshape(-1, 1, 1)
        sky, road = torch.tensor([150.0, 180.0, 220.0]), torch.tensor([90.0, 90.0, 95.0])
        noise = 20.0 * torch.randn(size.height, size.width, 1, generator=generator)
        image = (torch.where(rows < horizon, sky, road) + noise).clamp(0, 255).byte().contiguous()
        extent = torch.tensor([size.width - 1.0, size.height - 1.0, 75.0, 30.0, 20.0, 0.1])
        least = torch.tensor([0.0, 0.0, 3.0, -10.0, -10.0, 0.0])
        radar = torch.rand(size.points, 6, generator=generator) * extent + least
        slope = 1.0 / (focal_length_px * CAMERA_HEIGHT_M)
        return cls(image, radar, torch.tensor([0.0, slope, -slope * horizon, 1.0]))
