"""One random stream for each concern, so that changing one leaves the others as they were."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What a random stream decides."""

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


def generator(seed: int, stream: Stream, *indices: int) -> np.random.Generator:
    """The generator of a stream, and of one of its members (a chunk, a sweep) where indices are given."""
    return np.random.default_rng([seed, int(stream), *indices])
