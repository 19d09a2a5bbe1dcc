"""Pairing: each image with its nearest radar sweeps."""

from radcam_depth_ros.pairing.pairer import Pairer
from radcam_depth_ros.pairing.values import (
    ADJUSTABLE,
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
    "ADJUSTABLE",
    "MAX_SWEEPS",
    "EarlierSweep",
    "Pair",
    "Pairer",
    "PairingConfig",
    "PairingCounts",
    "PairingError",
    "RadarCounts",
    "for_each_radar",
]
