"""Pairs each image with its nearest radar sweeps."""

from radcam_depth_ros.pairing.clocks import (
    CLOCK_CERTAIN_S,
    CLOCK_WARNING_S,
    MAX_TIME_OFFSET_S,
    clock_warning,
    unset_stamps,
)
from radcam_depth_ros.pairing.pairer import Pairer
from radcam_depth_ros.pairing.values import (
    MAX_SWEEPS,
    EarlierSweep,
    Pair,
    PairingConfig,
    PairingCounts,
    PairingError,
    RadarCounts,
    for_each_radar,
)

__all__ = [
    "CLOCK_CERTAIN_S",
    "CLOCK_WARNING_S",
    "MAX_SWEEPS",
    "MAX_TIME_OFFSET_S",
    "EarlierSweep",
    "Pair",
    "Pairer",
    "PairingConfig",
    "PairingCounts",
    "PairingError",
    "RadarCounts",
    "clock_warning",
    "for_each_radar",
    "unset_stamps",
]
