"""Pairing: each image with its nearest radar sweeps."""

from radcam_depth_ros.pairing.pairer import Pairer
from radcam_depth_ros.pairing.values import Pair, PairingConfig, PairingCounts, PairingError, RadarCounts

__all__ = ["Pair", "Pairer", "PairingConfig", "PairingCounts", "PairingError", "RadarCounts"]
