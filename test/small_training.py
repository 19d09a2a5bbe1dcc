"""A network of two convolutions and its training, in this process or in others that are killed or share the work."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

# An optimiser and a picture ask for these: processes that are forked from one that knows this module start at once.
import matplotlib.figure  # noqa: F401
import torch
import torch._dynamo
from torch import Tensor, nn

from radcam_depth_ros.networks import Association, Depths, Network, TrainOutputs, registry
from radcam_depth_ros.reporting import page
from radcam_depth_ros.training import fit
from radcam_depth_ros.training.data.sample_sets import SampleSet, TrainingData
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.distributed.normalisation import join_batch_norms
from radcam_depth_ros.training.distributed.ranks import Ranks, joined
from radcam_depth_ros.training.fit import Trainer
from radcam_depth_ros.training.observer import StepReport, ValidationReport
from radcam_depth_ros.training.recipe import PhaseConfig, TrainingConfig, recipe_of


@dataclass(frozen=True)
class MiniatureConfig:
    """What every network's config has."""

    focal_length_px: float = 630.0
    min_depth_m: float = 1.0
    max_depth_m: float = 100.0
    calibration: tuple[float, float] = (1.0, 0.0)


class Miniature(Network):
    """Two convolutions, and one logit a pixel that all returns share: quick, and with all that training asks for."""

    config_type = MiniatureConfig
    adjustable = ("calibration",)
    trained_like = "baff"

    def __init__(self, config: MiniatureConfig) -> None:
        super().__init__(config)
        self.layers = nn.Sequential(
            nn.Conv2d(3, 16, 5, padding=2, bias=False), nn.BatchNorm2d(16), nn.ReLU(), nn.Conv2d(16, 3, 5, padding=2)
        )

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        depths = self.train_outputs(image, radar, valid, ground).depths
        assert depths is not None
        return depths

    def train_outputs(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> TrainOutputs:
        raw = self.layers(image).float()
        dense = 1 + 99 * torch.sigmoid(raw[:, :1])
        column = torch.arange(image.shape[3]).expand(*valid.shape, -1)
        association = Association(
            raw[:, 1:2].expand(-1, valid.shape[1], -1, -1),
            radar[:, :, 2:3].unsqueeze(3),
            torch.where(valid.unsqueeze(2), column, -1),
        )
        confidence = raw[:, 2:]
        return TrainOutputs(Depths(dense, dense, torch.sigmoid(confidence)), confidence, association, None, None)


RECIPE = recipe_of("baff")
CONFIG = replace(
    RECIPE,
    iterations=6,
    log_every_iterations=2,
    phases=(PhaseConfig(0.5, ((64, 64),), 2), PhaseConfig(0.5, ((64, 96),), 1)),
    optimiser=replace(RECIPE.optimiser, warm_up_iterations=2),
    validation=replace(RECIPE.validation, every_iterations=4, frames=1),
)


class Watch:
    """Counts what a run tells."""

    def __init__(self) -> None:
        self.steps: list[StepReport] = []
        self.validations: list[int] = []
        self.notes: list[str] = []

    def on_step(self, report: StepReport) -> None:
        self.steps.append(report)

    def on_validation(self, report: ValidationReport) -> None:
        self.validations.append(report.step)

    def on_note(self, text: str) -> None:
        self.notes.append(text)


class Lingering(Watch):
    """Does not let the last iteration end: so a run is there to be killed, however late that comes."""

    def __init__(self, iterations: int) -> None:
        super().__init__()
        self._iterations = iterations

    def on_step(self, report: StepReport) -> None:
        super().on_step(report)
        while report.step == self._iterations:
            time.sleep(1.0)


class Grown:
    """Drives that have come since a run began."""

    def __init__(self, *folders: Path) -> None:
        self._folders = folders

    def take(self) -> tuple[Path, ...]:
        """All of them, once."""
        folders, self._folders = self._folders, ()
        return folders


def data_of(drive: CachedDrive) -> TrainingData:
    """Five frames to train on, one to validate on."""
    train, validation = SampleSet.of([drive]).split(0.2)
    return TrainingData(train, validation, "six made-up frames")


def train_here(
    network: str,
    config: TrainingConfig,
    drive: Path,
    folder: Path,
    resume: bool,
    environment: Mapping[str, str],
    lingers: bool = False,
    grows: bool = False,
) -> None:
    """Runs a training as a process of its own; leaves weights, statistics and the last gradients in `N.pt`.

    Batch norms are the joint ones also where it is alone: torch's own sum up with more rounding.
    """
    os.environ.update(environment)
    create = fit.networks.create

    def create_joint(name: str, architecture: Mapping[str, Any]) -> Network:
        made = create(name, architecture)
        join_batch_norms(made, Ranks())
        return made

    if "RANK" not in environment:
        fit.networks.create = create_joint
    page.draw_plot = lambda plot: b"<svg/>"  # the plots of its page would take most of its time
    registry._NETWORKS["miniature"] = Miniature
    torch.set_num_threads(1)
    folder.mkdir(exist_ok=True)
    watch = Lingering(config.iterations) if lingers else Watch()
    with joined() as ranks:
        # The other processes have it from the first one.
        growth: Any = Grown(*((drive, drive) if ranks.is_first else ())) if grows else None
        data = data_of(CachedDrive(drive))
        trainer = Trainer(network, data, config, folder, watch, resume, ranks=ranks, growth=growth)
        trainer.run()
        gradients = {name: value.grad for name, value in trainer.network.named_parameters()}
        torch.save({"weights": trainer.network.state_dict(), "gradients": gradients}, folder / f"{ranks.rank}.pt")
