"""Validates weights on held-out frames during training by a few metrics. `evaluation` has all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.networks import Network
from radcam_depth_ros.training.calibration import LogitCounts
from radcam_depth_ros.training.data.batches import collate
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.precision import Precision

LIMITS_M = (50.0, 80.0)
TOLERANCE = 0.1
"""A depth is right when it is this near to the truth, relatively: what the confidence is the probability of."""


@dataclass(frozen=True)
class ValidationResult:
    """Means over frames; metres.

    Attributes:
        mae_50_m: Mean absolute error of the dense depth within 50 m.
        rmse_50_m: Root mean square error within 50 m.
        mae_80_m: Mean absolute error within 80 m, which the best weights are chosen by.
        rmse_80_m: Root mean square error within 80 m.
        semi_dense_share: Share of the pixels nearer than 80 m that stage 1 gave a depth.
        semi_dense_mae_m: Mean absolute error of these; NaN where there are none.
        confidence_gap: Mean confidence where the dense depth is within 10 %, minus where it is not.
    """

    mae_50_m: float
    rmse_50_m: float
    mae_80_m: float
    rmse_80_m: float
    semi_dense_share: float
    semi_dense_mae_m: float
    confidence_gap: float


def validate(
    network: Network, samples: Sequence[TrainingSample], precision: Precision, ranks: Ranks | None = None
) -> tuple[ValidationResult, LogitCounts]:
    """Runs a network, as a vehicle would, over whole frames.

    Args:
        network: In evaluation mode.
        samples: Held-out frames, each at its full size with all its returns.
        precision: Number format and device.
        ranks: Processes that share the frames, and all get the result.

    Returns:
        Means over the frames, and how often the depth was right at each confidence.
    """
    ranks = ranks or Ranks()
    part = [
        _measure(sample.depth_m.astype(np.float32), *predict(network, sample, precision))
        for sample in samples[ranks.rank :: ranks.size]
    ]
    parts = ranks.gather(part)
    results = [parts[index % ranks.size][index // ranks.size] for index in range(len(samples))]
    rows = [row for row, _ in results]
    with np.errstate(invalid="ignore"):
        table = np.array(rows)
        known = np.isfinite(table)
        means = np.where(known, table, 0).sum(axis=0) / known.sum(axis=0)
    counts = sum((found for _, found in results), LogitCounts.none())
    return ValidationResult(*(float(value) for value in means)), counts


def predict(network: Network, sample: TrainingSample, precision: Precision) -> tuple[FloatArray, ...]:
    """Dense depth, semi-dense depth and confidence of a whole frame, each (H, W) float32."""
    batch = collate([sample]).to(precision.device)
    with torch.inference_mode(), precision.autocast():
        depths = network(batch.image, batch.radar, batch.valid, batch.ground)
    return tuple(image[0, 0].float().cpu().numpy() for image in depths[:3])


def _measure(
    truth: np.ndarray, dense: np.ndarray, semi_dense: np.ndarray, confidence: np.ndarray
) -> tuple[list[float], LogitCounts]:
    row: list[float] = []
    for limit in LIMITS_M:
        counts = (truth > 0) & (truth <= limit)
        error = np.clip(dense[counts], 0, limit) - truth[counts]
        row += [_mean(np.abs(error)), float(np.sqrt(_mean(error**2)))]
    covered = counts & np.isfinite(semi_dense)
    row.append(float(covered.sum() / max(counts.sum(), 1)))
    row.append(_mean(np.abs(np.clip(semi_dense[covered], 0, 80) - truth[covered])))
    right = np.abs(dense - truth) < TOLERANCE * truth
    row.append(_mean(confidence[counts & right]) - _mean(confidence[counts & ~right]))
    return row, LogitCounts.of(confidence[counts], right[counts])


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")
