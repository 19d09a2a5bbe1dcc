"""Writes the depth of one drive to a bag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from radcam_depth_ros import configuration
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.fleet.unit import Unit, Worker
from radcam_depth_ros.fleet.work.weights import Weights
from radcam_depth_ros.replay import ReplayOptions, replay


@dataclass(frozen=True)
class Replaying:
    """The work of `radcam-depth replay` with many bags.

    Attributes:
        weights: The network.
        drive: How bags are read.
        options: What is written.
    """

    weights: Weights
    drive: DriveSettings
    options: ReplayOptions

    verb: ClassVar[str] = "replay"
    suffix: ClassVar[str] = ".mcap"
    reads_bags: ClassVar[bool] = True

    @property
    def threads(self) -> int:
        """Those of the network."""
        return self.weights.computation.threads

    def settings(self) -> dict[str, Any]:
        """All but where the bags are."""
        options = configuration.as_mapping(replace(self.options, overwrite=False))
        size = {"output_size": self.weights.config.output_size}
        return {**self.weights.settings(), **size, "options": options, "drive": configuration.as_mapping(self.drive)}

    def facts(self) -> dict[str, Any]:
        """The weights."""
        return self.weights.facts()

    def open(self) -> Worker:
        """Loads the network."""
        estimator = self.weights.load()
        # A bag without its result is one whose process was killed in between.
        options = replace(self.options, overwrite=True)

        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            summary = replay(bag, target, estimator, self.drive, options)
            return {"images": summary.images, "frames": summary.frames, "without_radar": summary.without_radar}

        return work
