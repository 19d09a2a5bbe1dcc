"""Validates weights on held-out frames during training by a few metrics, and calibrates their confidence there.

`evaluation` has all metrics. The confidence is calibrated by Platt scaling ([Platt1999]) of its logit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.networks import Network
from radcam_depth_ros.training.data.batches import collate
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import TrainingSample
from radcam_depth_ros.training.distributed.ranks import Ranks
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.precision import Precision

LIMITS_M = (50.0, 80.0)
TOLERANCE = 0.1
"""A depth is right when it is this near to the truth, relatively: what the confidence is the probability of."""


FARTHEST_LOGIT, BINS = 12.0, 240
"""Logits are counted in bins of a tenth; a confidence nearer to 0 or 1 than 6e-6 is told from no other."""

STEPS, LEAST_SCALE, DAMPING = 50, 0.05, 1e-3
"""Of Newton's method; a scale below the least would say that the confidence tells nothing."""


@dataclass(frozen=True)
class LogitCounts:
    """How many pixels had a confidence's logit, and at how many of them the depth was right.

    Attributes:
        counts: (2, BINS) float64: all pixels, and the right ones.
    """

    counts: npt.NDArray[np.float64]

    @classmethod
    def of(cls, confidence: npt.NDArray[np.float32], right: npt.NDArray[np.bool_]) -> LogitCounts:
        """Those of a frame.

        Args:
            confidence: (P,) float32, 0 to 1.
            right: (P,) bool, whether the depth is within 10 % of the truth.
        """
        share = np.clip(confidence.astype(np.float64), 1e-9, 1 - 1e-9)
        logit = np.log(share) - np.log1p(-share)
        place = np.floor((logit + FARTHEST_LOGIT) * BINS / (2 * FARTHEST_LOGIT))
        index = np.clip(place, 0, BINS - 1).astype(np.int64)
        return cls(np.stack([np.bincount(index, weights, BINS) for weights in (None, right.astype(np.float64))]))

    @classmethod
    def none(cls) -> LogitCounts:
        """Of no pixel."""
        return cls(np.zeros((2, BINS)))

    def __add__(self, other: LogitCounts) -> LogitCounts:
        return LogitCounts(self.counts + other.counts)

    def shares(self) -> npt.NDArray[np.float64]:
        """The counts as shares of all pixels."""
        return self.counts / max(float(self.counts[0].sum()), 1.0)


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


def platt_scaling(kinds: Sequence[LogitCounts], former: tuple[float, float]) -> tuple[float, float]:
    """Scale and offset of the logit at which what was right is likeliest, each kind of frames counting alike.

    Args:
        kinds: Counts of each kind of frames.
        former: Scale and offset that the counted confidence was made with.

    Returns:
        Scale and offset of the network's own logit; the former ones where no pixel was counted, or all were right.
    """
    counts = np.sum([kind.shares() for kind in kinds], axis=0)
    every, right = counts
    if not 0 < right.sum() < every.sum():
        return former
    logit = (np.arange(BINS) + 0.5) * (2 * FARTHEST_LOGIT / BINS) - FARTHEST_LOGIT
    columns = np.stack([logit, np.ones(BINS)])
    values = np.array([1.0, 0.0])
    for _ in range(STEPS):
        probability = 1 / (1 + np.exp(-np.clip(values @ columns, -50, 50)))
        gradient = columns @ (every * probability - right)
        hessian = (columns * (every * probability * (1 - probability))) @ columns.T
        step = np.linalg.solve(hessian + DAMPING * np.eye(2), gradient)
        values = values - np.clip(step, -1, 1)
        values[0] = max(values[0], LEAST_SCALE)
    scale, offset = (float(value) for value in values)
    return scale * former[0], scale * former[1] + offset


def spread(samples: SampleSet | None, count: int) -> list[TrainingSample]:
    """`count` samples to validate on, evenly over all; none of None.

    Raises:
        TrainingError: when none of them has ground truth within 80 m.
    """
    if samples is None:
        return []
    chosen = [samples[index] for index in samples.spread(count)]
    if not any(((sample.depth_m > 0) & (sample.depth_m <= 80)).any() for sample in chosen):
        raise TrainingError(
            f"none of the {len(chosen)} frames to validate on has ground truth nearer than 80 m; give others with "
            "--validation-bags"
        )
    return chosen
