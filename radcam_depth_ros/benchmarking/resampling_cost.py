"""Times the estimator's resampling for a camera whose image has twice the network's size."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from radcam_depth_ros.benchmarking.rotation import Task, Times
from radcam_depth_ros.benchmarking.subject import Size
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.frame import CameraModel, Frame, RadarReturns
from radcam_depth_ros.networks import Depths
from radcam_depth_ros.networks.weights_io.archive import Archive, Card

RESAMPLE, RESAMPLE_BACK = "resample", "resample back"
_AS_IT_IS, _SMALLER, _BOTH_WAYS = "estimator alone", "estimator, resampling", "estimator, resampling both ways"


class _ConstantDepth(nn.Module):
    """A network that does nothing."""

    def forward(self, image: Tensor, radar: Tensor, valid: Tensor, ground: Tensor) -> Depths:
        depth = torch.full_like(image[:, :1], 10.0)
        return Depths(depth, depth, depth)


def estimator_tasks(size: Size, focal_length_px: float, device: str) -> tuple[Task, ...]:
    """A whole estimate without a network: without resampling, with it, and with resampling back as well."""
    archive = Archive(_ConstantDepth().eval(), Card("constant", {}, focal_length_px, 1.0, 100.0, "nothing"))
    forms: tuple[tuple[str, int, str], ...] = (
        (_AS_IT_IS, 1, "native"),
        (_SMALLER, 2, "network"),
        (_BOTH_WAYS, 2, "native"),
    )
    tasks: list[Task] = []
    for name, factor, output_size in forms:
        estimator = Estimator(EstimatorConfig(device=device, output_size=output_size), archive)
        call = _estimate(estimator, size, factor, focal_length_px)
        for _ in range(3):
            call()
        tasks.append(Task(name, call))
    return tuple(tasks)


def resampling_ms(times: Times) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Milliseconds of each round, (rounds,), as differences between the estimates; not below 0."""
    smaller, both_ways = times.of(_SMALLER), times.of(_BOTH_WAYS)
    return {
        RESAMPLE: np.maximum(smaller - times.of(_AS_IT_IS), 0.0),
        RESAMPLE_BACK: np.maximum(both_ways - smaller, 0.0),
    }


def _estimate(estimator: Estimator, size: Size, factor: int, focal_length_px: float) -> Callable[[], object]:
    width, height, focal = factor * size.width, factor * size.height, factor * focal_length_px
    camera = CameraModel(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    image = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    return partial(estimator.estimate, Frame(0, "camera", image, camera, RadarReturns.from_points([[0.0, 0.0, 10.0]])))
