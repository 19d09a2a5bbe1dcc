"""A trained network that another one learns from."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.data.batches import Batch
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.losses.distillation import DistillationConfig, distillation_loss, features_of
from radcam_depth_ros.training.precision import Precision


class Teacher:
    """A network with fixed weights and statistics, and what a student is told by it.

    Args:
        source: A network's name, for the weights that come with the package, or a weight file.
        student: The network that learns.
        config: Weights of what is told.
        precision: What is computed in, and where.

    Raises:
        TrainingError: when it is an export, or sees images otherwise than the student.
        ArchiveError: when the weights cannot be loaded.
    """

    def __init__(
        self, source: str | Path, student: networks.Network, config: DistillationConfig, precision: Precision
    ) -> None:
        given = archive.load(source)
        if given.is_export:
            raise TrainingError(f"{source} is an export, and an export cannot teach; give the .safetensors file")
        for key in ("focal_length_px", "max_depth_m"):
            mine, theirs = getattr(student.config, key), getattr(given.network.config, key)
            if mine != theirs:
                raise TrainingError(
                    f"the teacher {source} was trained at {key} {theirs:g}, the student is at {mine:g}; set "
                    f"architecture.{key}: {theirs:g} in the recipe, or take another teacher"
                )
        self.name = given.card.network
        self._config = config
        self._precision = precision
        network = given.network.eval().requires_grad_(False).to(precision.device)
        self._network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch lacks it

    def loss(self, outputs: object, student: str, batch: Batch, ranks: Ranks) -> tuple[Tensor, dict[str, Tensor]]:
        """What the student is told for a batch.

        Args:
            outputs: What the student's `train_outputs` gave.
            student: Its name.
            batch: What it was given.
            ranks: The processes that share the batch.

        Returns:
            The total, with its gradient, and its parts before weighting without, by name.

        Raises:
            TrainingError: when either of both has no features, or they do not fit each other.
        """
        mine = features_of(outputs, student)
        with torch.no_grad(), self._precision.autocast():
            given = self._network.train_outputs(batch.image, batch.radar, batch.valid, batch.ground)
        return distillation_loss(mine, features_of(given, self.name), self._config, ranks)
