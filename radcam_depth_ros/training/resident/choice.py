"""Makes batches where a recipe says: of samples on a disk, or in the device's memory."""

from __future__ import annotations

from typing import Any

import torch

from radcam_depth_ros.extras import install_extra
from radcam_depth_ros.training.data.augmentation import AugmentationConfig
from radcam_depth_ros.training.data.batches import BatchMaker, Maker
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.errors import TrainingError


def maker_of(
    place: str,
    device: torch.device,
    samples: SampleSet,
    config: AugmentationConfig,
    seed: int,
    rehearsal: SampleSet | None = None,
    rehearsal_share: float = 0.0,
) -> Maker[Any]:
    """A maker of batches.

    Args:
        place: Where samples are held, `disk` or `device`.
        device: On which the network is.
        samples: What there is.
        config: Augmentation.
        seed: Of order and augmentation.
        rehearsal: Samples that are mixed in.
        rehearsal_share: Share of these among all.

    Raises:
        TrainingError: when the samples do not fit into the device's memory, or kornia is missing.
    """
    given = (samples, config, seed, rehearsal, rehearsal_share)
    if place == "disk":
        return BatchMaker(*given)
    try:
        # kornia takes seconds to import.
        from radcam_depth_ros.training.resident.batches import ResidentBatchMaker
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "kornia":
            raise
        raise TrainingError(f"samples: device needs kornia; {install_extra('train')}; or set samples: disk") from None
    return ResidentBatchMaker(*given, device)
