"""Weights that travel with the work, so that other computers need no file of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radcam_depth_ros.estimator import Computation, Estimator, EstimatorConfig
from radcam_depth_ros.fleet.errors import FleetError


@dataclass(frozen=True)
class Weights:
    """A network as one process loaded it, for others to load the same.

    Attributes:
        config: With the number format and the threads that were chosen there.
        network: Name of the network.
        about: The estimator in one line.
        computation: What the digits of depth follow from.
        files: Content of the weight file, and of the card beside it, by name; empty for the package's own weights.
        loaded: The estimator, in the process where it was loaded.
    """

    config: EstimatorConfig
    network: str
    about: str
    computation: Computation
    files: tuple[tuple[str, bytes], ...]
    loaded: Estimator | None = field(default=None, compare=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "loaded": None}

    @classmethod
    def of(cls, estimator: Estimator) -> Weights:
        """Those of an estimator."""
        config, computation = estimator.config, estimator.computation
        file = Path(config.model_file) if config.model_file else None
        kept = [path for path in (file, file.with_suffix(".yaml")) if path.is_file()] if file else []
        return cls(
            replace(config, precision=computation.precision, threads=computation.threads),
            estimator.card.network,
            estimator.describe(),
            computation,
            tuple((path.name, path.read_bytes()) for path in kept),
            estimator,
        )

    def load(self) -> Estimator:
        """The same estimator in this process.

        Raises:
            FleetError: when this computer's package has other weights of that name.
            ArchiveError: when they cannot be loaded.
        """
        if self.loaded is not None:
            return self.loaded
        with TemporaryDirectory(prefix="radcam_depth_weights_") as folder:
            for name, content in self.files:
                (Path(folder) / name).write_bytes(content)
            model_file = str(Path(folder) / self.files[0][0]) if self.files else ""
            estimator = Estimator(replace(self.config, model_file=model_file))
        found = estimator.computation
        if found != self.computation:
            raise FleetError(
                f"expected {self.computation} here as where the run began, got {found}; install the same version of "
                "this package on all computers"
            )
        return estimator

    def settings(self) -> dict[str, Any]:
        """What decides the depth."""
        computed = vars(self.computation)
        return {"network": self.network, "device": self.config.device, "runtime": self.config.runtime, **computed}

    def facts(self) -> dict[str, Any]:
        """What is told with results, as the JSON of an evaluation has it."""
        return {"weights": self.about, **vars(self.computation)}
