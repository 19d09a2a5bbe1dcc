"""Draws the LiDAR of a seed: beams, range and sensitivity of units on the market."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.settings.randomness import pick
from radcam_depth_ros.simulation.settings.sensor_configuration import LidarConfig, LidarUnit
from radcam_depth_ros.simulation.world.centre_line import DoubleArray


@dataclass(frozen=True)
class Beams:
    """Beams and sensitivity of a spinning LiDAR.

    Attributes:
        elevations_deg: (B,) of the beams.
        max_range_m: Nothing further away is reported.
        weakest: Reflectivity of a surface that is just seen at 50 m.
    """

    elevations_deg: DoubleArray
    max_range_m: float
    weakest: float


# Elevations of the VLP-32C are those of its manual; the others are even, the HDL-64E in two blocks.
_VLP_32C_DEG = (
    *(-25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333),
    *(-2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0),
    *(10.333, 15.0),
)
_HDL_64E_DEG = np.concatenate([np.linspace(-24.33, -8.83, 32), np.linspace(-8.33, 2.0, 32)])
_UNITS: dict[LidarUnit, Beams] = {
    LidarUnit.VLP_16: Beams(np.linspace(-15, 15, 16), 100.0, 0.03),
    LidarUnit.HDL_32E: Beams(np.linspace(-30.67, 10.67, 32), 100.0, 0.03),
    LidarUnit.VLP_32C: Beams(np.array(_VLP_32C_DEG), 200.0, 0.012),
    LidarUnit.HDL_64E: Beams(_HDL_64E_DEG, 120.0, 0.02),
    LidarUnit.OS1_64: Beams(np.linspace(-16.6, 16.6, 64), 120.0, 0.025),
}


def draw_beams(config: LidarConfig, rng: np.random.Generator) -> Beams:
    """The unit that is configured, or one of all; with as many beams as are configured."""
    drawn = pick(rng, list(_UNITS))
    found = _UNITS[drawn if config.unit is LidarUnit.ANY else config.unit]
    elevations: npt.NDArray[np.float64] = found.elevations_deg
    if config.beams is not None:
        elevations = np.linspace(elevations[0], elevations[-1], config.beams)
    return Beams(elevations, min(found.max_range_m, config.max_range_m), found.weakest)
