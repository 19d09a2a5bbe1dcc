"""The simulation's error, and the check that raises it."""

from __future__ import annotations

from radcam_depth_ros.frame import RadcamDepthError


class SimulationError(RadcamDepthError):
    """A simulation that cannot be run as configured."""


def require(ok: bool, message: str) -> None:
    """Raises SimulationError with the message unless `ok`."""
    if not ok:
        raise SimulationError(message)
