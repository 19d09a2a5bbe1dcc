"""Simulates one drive, into a bag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import cv2

from radcam_depth_ros import configuration
from radcam_depth_ros.fleet.unit import Unit, Worker

if TYPE_CHECKING:
    from radcam_depth_ros.simulation import SimulationConfig


@dataclass(frozen=True)
class Simulating:
    """The work of `radcam-depth simulate --seeds`.

    Attributes:
        config: What to simulate.
        frames: Images of a drive.
    """

    config: SimulationConfig
    frames: int

    verb: ClassVar[str] = "simulate"
    suffix: ClassVar[str] = ".mcap"
    reads_bags: ClassVar[bool] = False

    @property
    def threads(self) -> int:
        """One."""
        return 1

    def settings(self) -> dict[str, Any]:
        """All but the seeds."""
        return {"frames": self.frames, "simulation": configuration.as_mapping(self.config)}

    def facts(self) -> dict[str, Any]:
        """None."""
        return {}

    def open(self) -> Worker:
        """Has OpenCV keep to one thread: there are as many processes as cores."""
        from radcam_depth_ros import simulation  # here, so that all else runs without the extra `sim`

        cv2.setNumThreads(1)

        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            simulation.simulate(self.config, unit.seed, self.frames, target, overwrite=True)
            return {"frames": self.frames}

        return work
