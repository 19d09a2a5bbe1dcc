"""Random streams, one for each concern so that changing one leaves the others as they were, and draws from them."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import TypeVar

import numpy as np
import numpy.typing as npt

OptionT = TypeVar("OptionT")


class Stream(IntEnum):
    """Concerns, each with a random stream of its own."""

    STYLE = 0
    TEXTURES = 1
    PATH = 2
    PROTOTYPES = 3
    CHUNK = 4
    TRAFFIC = 5
    EGO = 6
    RIG = 7
    LENS = 8
    CAMERA = 9
    RADAR = 10
    IMAGING_RADAR = 11
    LIDAR = 12
    ODOMETRY = 13
    RELIEF = 14
    CLOCKS = 15
    DISGUISE = 16
    LOOKS = 17


def generator(seed: int, stream: Stream, *indices: int) -> np.random.Generator:
    """The generator of a stream, and of one of its members (a chunk, a sweep) where indices are given."""
    return np.random.default_rng([seed, int(stream), *indices])


def pick(rng: np.random.Generator, options: Sequence[OptionT], weights: npt.ArrayLike | None = None) -> OptionT:
    """One of some options; each is equally likely, or as likely as its share of the weights."""
    if weights is None:
        return options[int(rng.integers(len(options)))]
    shares = np.asarray(weights, np.float64)
    return options[int(rng.choice(len(options), p=shares / shares.sum()))]


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two bounds, uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
