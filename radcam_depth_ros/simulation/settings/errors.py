"""The simulation's error, and the checks of settings that raise it."""

from __future__ import annotations

from collections.abc import Mapping

from radcam_depth_ros.frame import RadcamDepthError


class SimulationError(RadcamDepthError):
    """A simulation that cannot be run as configured."""


def require(ok: bool, message: str) -> None:
    """Raises SimulationError with the message unless `ok`."""
    if not ok:
        raise SimulationError(message)


def require_positive_rate(section: str, rate_hz: float) -> None:
    """Raises SimulationError unless a sensor measures at all."""
    require(rate_hz > 0, f"{section}.rate_hz must be positive, got {rate_hz}")


def require_ranges(section: str, config: object, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Raises SimulationError unless each of these fields lies in its range, bounds included."""
    for name, (least, most) in ranges.items():
        value = getattr(config, name)
        require(least <= value <= most, f"{section}.{name} must be {least:g} to {most:g}, got {value}")


def require_pairs(section: str, config: object, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Raises SimulationError unless min_NAME and max_NAME of each name lie in its range, in this order."""
    for name, (least, most) in ranges.items():
        low, high = getattr(config, f"min_{name}"), getattr(config, f"max_{name}")
        require(
            least <= low <= high <= most,
            f"{section}.min_{name} and {section}.max_{name} must be {least:g} to {most:g} and in order, "
            f"got {low} and {high}",
        )
