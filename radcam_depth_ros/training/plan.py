"""Reads and writes the plan of a run: data, recipe, and sources of its weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import yaml

from radcam_depth_ros import configuration
from radcam_depth_ros.drive import DriveSettings, TopicChoice
from radcam_depth_ros.files import write_text
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.pairing import PairingConfig
from radcam_depth_ros.training import recipe
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.initial import Sources
from radcam_depth_ros.training.recipe import TrainingConfig

RUN_FILE = "run.yaml"


@dataclass(frozen=True)
class RunPlan:
    """All that a run needs to begin, and to go on.

    Attributes:
        network: Name of the network.
        config: The recipe.
        bags: Bags to train on.
        validation_bags: Bags to choose the best weights by; some of `bags` are held out where there are none.
        rehearsal_bags: Bags to rehearse; simulated where there are none and the recipe rehearses.
        cache: Folder of prepared samples.
        sources: Weights that it starts or learns from.
        ground_truth: Which one is taken of the bags, see `DriveSettings`.
        frame_builder: How frames are made of the bags, as in the node.
        topics: Which topics of the bags are read.
        growing: Places that are looked into for more bags while it trains; none where all bags are there.
    """

    network: str
    config: TrainingConfig
    bags: tuple[str, ...]
    validation_bags: tuple[str, ...] = ()
    rehearsal_bags: tuple[str, ...] = ()
    cache: str = "cache"
    sources: Sources = field(default_factory=Sources)
    ground_truth: str = "any"
    frame_builder: FrameBuilderConfig = field(default_factory=FrameBuilderConfig)
    topics: TopicChoice = field(default_factory=TopicChoice)
    growing: tuple[str, ...] = ()

    @property
    def drive(self) -> DriveSettings:
        """How the bags are read."""
        return DriveSettings(
            self.frame_builder,
            self.topics,
            self.ground_truth,
            accumulate="where_possible",
            accumulation=self.config.accumulation,
        )

    @property
    def rehearsed_drive(self) -> DriveSettings:
        """How rehearsed bags are read: of another vehicle, with as many sweeps and the best truth that they have."""
        pairing = self.frame_builder.pairing
        return DriveSettings(
            FrameBuilderConfig(
                radar_motion_compensation=self.frame_builder.radar_motion_compensation,
                pairing=PairingConfig(radar_sweeps=pairing.radar_sweeps, max_sweep_age_s=pairing.max_sweep_age_s),
            ),
            accumulate="where_possible",
        )

    def write(self, folder: Path) -> None:
        """Writes `run.yaml` into the run's folder."""
        write_text(folder / RUN_FILE, yaml.safe_dump(configuration.as_mapping(self), sort_keys=False))

    @classmethod
    def read(cls, folder: Path) -> RunPlan:
        """Reads `run.yaml` of a run's folder.

        Raises:
            TrainingError: when there is none.
            ConfigurationError: when it does not fit.
        """
        path = folder / RUN_FILE
        if not path.is_file():
            raise TrainingError(
                f"{folder} holds no run to resume: {path} is missing; leave --resume out to start a run"
            )
        values = configuration.read(path)
        given = values.get("config")
        # A run of an earlier version may lack values that recipes have now.
        config = recipe.build(given, str(path)) if isinstance(given, dict) else given
        return configuration.build(cls, {**values, "config": config} if "config" in values else values, str(path))
