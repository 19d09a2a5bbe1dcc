"""Collects evidence that an unnamed quantity of a radar, its intensity, is the Doppler speed."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.frame import FloatArray, RadarReturns
from radcam_depth_ros.geometry import DoubleArray

_LEAST_RETURNS = 15
_MOST_RETURNS = 200
"""Of a sweep so many are looked at, evenly spread."""
_TRIALS = 40
_TOLERANCE = 0.5
"""Speeds of what stands fit the vehicle's motion within this, m/s."""
_FITTING_SHARE = 0.4
"""At least so many of the returns are of what stands; a radar cross section varies by tens of dB."""
_ADVANTAGE = 1.3
"""So many times as many values fit as where they are shuffled."""
_CONSTANT_SHARE = 2 / 3
_SLOWEST, _FASTEST = 1.0, 70.0
"""Speeds of a vehicle that tell, m/s."""
_ENOUGH_SWEEPS = 8
_ENOUGH_SHARE = 0.3
"""A radar cross section fits by chance in one sweep of ten at most, where sweeps have 15 returns."""
_MOST_SWEEPS = 200
"""After so many that tell, nothing is looked at any more."""


class DopplerEvidence:
    """Looks whether values fit the Doppler of a moving vehicle: what stands has its speed along the line of sight.

    Sweeps tell nothing that have few returns, in which most values are the same, or that fit a vehicle at rest.

    Attributes:
        sweeps: How many sweeps tell something.
        fitting: How many of them fit.
    """

    def __init__(self) -> None:
        self.sweeps = self.fitting = 0

    @property
    def is_strong(self) -> bool:
        """Whether the values are likely speeds."""
        return self.fitting >= max(_ENOUGH_SWEEPS, _ENOUGH_SHARE * self.sweeps)

    def add(self, returns: RadarReturns) -> None:
        """Takes the positions and the values, which were read as `rcs_dbsm`, of a sweep."""
        if self.sweeps >= _MOST_SWEEPS:
            return
        known = np.flatnonzero(np.isfinite(returns.rcs_dbsm) & returns.xyz_m.any(axis=1))
        if len(known) < _LEAST_RETURNS:
            return
        rows = known[:: -(-len(known) // _MOST_RETURNS)]
        values = returns.rcs_dbsm[rows].astype(np.float64)
        if (np.abs(values - np.median(values)) <= _TOLERANCE).mean() >= _CONSTANT_SHARE:
            return
        speed, share = _fit(returns.xyz_m[rows], values)
        if share >= _FITTING_SHARE and speed <= _SLOWEST:
            return
        self.sweeps += 1
        if share >= _FITTING_SHARE and speed <= _FASTEST:
            _, by_chance = _fit(returns.xyz_m[rows], np.random.default_rng(1).permutation(values))
            self.fitting += share >= _ADVANTAGE * by_chance


def _fit(xyz_m: FloatArray, values: DoubleArray) -> tuple[float, float]:
    """The speed over ground of the motion that fits most values, m/s, and the share of values that it fits.

    Each trial takes the motion on the plane by two returns.
    """
    places = xyz_m.astype(np.float64)  # the square of a float32 may be none
    sight = places[:, :2] / np.linalg.norm(places, axis=1, keepdims=True)
    first, second = np.random.default_rng(0).integers(0, len(values), (2, _TRIALS))
    across = sight[first, 0] * sight[second, 1] - sight[first, 1] * sight[second, 0]
    told = np.abs(across) > 0.05  # nearly one line of sight tells one component alone
    if not told.any():
        return 0.0, 0.0
    first, second, across = first[told], second[told], across[told]
    velocities = (
        np.stack(
            (
                values[first] * sight[second, 1] - values[second] * sight[first, 1],
                values[second] * sight[first, 0] - values[first] * sight[second, 0],
            )
        )
        / across
    )  # (2, trials)
    shares = (np.abs(sight @ velocities - values[:, None]) <= _TOLERANCE).mean(axis=0)
    best = int(np.argmax(shares))
    return float(np.linalg.norm(velocities[:, best])), float(shares[best])
