"""Fits the confidence to what was right on held-out frames: Platt scaling ([Platt1999]) of its logit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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
