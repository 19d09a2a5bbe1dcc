"""Estimates a radar's own motion over ground from its Doppler."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import DoubleArray

_TRIES = 80
_LEAST_ANGLE = 0.02
_AGREES_MPS = 0.5
_SLOT = np.deg2rad(3.0)
"""What stands still is seen in many directions, a vehicle in few: directions count, not returns."""
_FEWEST_DIRECTIONS = 5
_LEAST_SHARE = 0.4
_THICK = 0.1
"""Directions that spread less than this out of a plane say nothing of the velocity across it."""


@dataclass(frozen=True)
class OwnMotion:
    """How a radar moved over ground.

    Attributes:
        velocity_mps: (3,) float64, in the radar's axes; 0 across the plane in which it measures.
        share: Share of the directions in which something agrees with that.
    """

    velocity_mps: DoubleArray
    share: float

    @property
    def speed_mps(self) -> float:
        """How fast."""
        return float(np.linalg.norm(self.velocity_mps))


def own_motion(xyz_m: FloatArray, radial_speed_mps: FloatArray) -> OwnMotion | None:
    """The velocity that explains most directions' Doppler; None where no velocity explains enough.

    A return that stands still has a radial speed of - direction . velocity. Velocities from pairs of returns are tried
    (RANSAC), the best one is refined by least squares.

    Args:
        xyz_m: (N, 3) returns in the radar's frame.
        radial_speed_mps: (N,) relative to the radar, positive moving away; NaN where not given.
    """
    distance_m = np.linalg.norm(xyz_m, axis=1)
    known = np.isfinite(radial_speed_mps) & (distance_m > 0.5)
    if known.sum() < _FEWEST_DIRECTIONS:
        return None
    sight = (xyz_m[known] / distance_m[known, None]).astype(np.float64)
    speed = radial_speed_mps[known].astype(np.float64)
    _, sizes, axes = np.linalg.svd(sight, full_matrices=False)
    dimensions = 3 if sizes[2] / np.sqrt(len(sight)) > _THICK else 2
    along = sight @ axes[:dimensions].T
    slots = np.floor(np.arctan2(along[:, 1], along[:, 0]) / _SLOT).astype(int)
    _, slots = np.unique(slots, return_inverse=True)
    count = int(slots.max()) + 1
    if count < _FEWEST_DIRECTIONS:
        return None
    pairs = np.random.default_rng(len(sight)).integers(0, len(sight), (_TRIES, 2))
    pairs = pairs[np.abs(np.linalg.det(along[pairs, :2])) > _LEAST_ANGLE]
    if not len(pairs):
        return None
    tried = -np.linalg.solve(along[pairs, :2], speed[pairs][..., None])[..., 0]
    agreeing = np.abs(speed + tried @ along[:, :2].T) < _AGREES_MPS
    in_slot = (slots[:, None] == np.arange(count)).astype(np.float32)
    directions = (agreeing.astype(np.float32) @ in_slot > 0).sum(axis=1)
    best = agreeing[int(directions.argmax())]
    if directions.max() < max(_FEWEST_DIRECTIONS, _LEAST_SHARE * count):
        return None
    for _ in range(3):
        found = -np.linalg.lstsq(along[best], speed[best], rcond=None)[0]
        best = np.abs(speed + along @ found) < _AGREES_MPS
        if best.sum() < _FEWEST_DIRECTIONS:
            return None
    share = len(np.unique(slots[best])) / count
    return OwnMotion(found @ axes[:dimensions], share)
