"""Values of pairing: limits, pairs, counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.setting import setting

ImageT = TypeVar("ImageT")
SweepT = TypeVar("SweepT")
ValueT = TypeVar("ValueT", str, float)


MAX_SWEEPS = 10
"""No image takes more sweeps of a radar."""
_LONGEST_AGE_S = 10.0


class PairingError(RadcamDepthError):
    """A pairing that cannot work as configured, or a radar that it does not know."""


@dataclass(frozen=True)
class PairingConfig:
    """How images and radar sweeps are paired."""

    max_time_offset_s: float = setting(
        0.1, "Largest distance in time between an image and a radar sweep of it, in seconds.", 0.0, 10.0, live=True
    )
    max_wait_s: float = setting(
        0.1,
        "Longest time that an image waits for a radar sweep that may be nearer, in seconds; by /clock with "
        "use_sim_time.",
        0.0,
        10.0,
        live=True,
    )
    radar_time_offset_s: float | tuple[float, ...] = setting(
        0.0,
        "Correction added to the radars' stamps, in seconds, where their clock or delay differs from the camera's. "
        "One number for all radars, or a list with one for each of radar_topics: -0.05, or [0.0, -0.05]. It is "
        "negative where the stamps are too late.",
        -10.0,
        10.0,
    )
    radar_sweeps: int = setting(
        1,
        "Number of sweeps of each radar that an image takes: the nearest and those before it. Several sweeps are "
        "moved to the image's time: static returns by the vehicle's motion, moving ones also by their Doppler, along "
        "the line of sight. While the motion is unknown, the nearest sweep is used alone, and the diagnostics say so.",
        1,
        MAX_SWEEPS,
    )
    max_sweep_age_s: float = setting(
        1.0,
        "Largest age of the sweeps before the nearest one, in seconds, with radar_sweeps above 1.",
        0.0,
        10.0,
        live=True,
    )

    def __post_init__(self) -> None:
        if not 1 <= self.radar_sweeps <= MAX_SWEEPS:
            raise PairingError(f"radar_sweeps must be 1 to {MAX_SWEEPS}, got {self.radar_sweeps}")
        for name in ("max_time_offset_s", "max_wait_s", "max_sweep_age_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise PairingError(f"{name} must be 0 or a positive number of seconds, got {value}")
        if self.max_sweep_age_s > _LONGEST_AGE_S:
            raise PairingError(f"max_sweep_age_s must be {_LONGEST_AGE_S:g} at most, got {self.max_sweep_age_s}")
        given = self.radar_time_offset_s
        if not all(math.isfinite(value) for value in (given if isinstance(given, tuple) else (given,))):
            raise PairingError(f"radar_time_offset_s must be a number of seconds, got {given}")


def for_each_radar(name: str, given: ValueT | tuple[ValueT, ...], radars: int) -> tuple[ValueT, ...]:
    """What is given once for all radars, or in a list for each, as one value a radar.

    Args:
        name: The setting's, for the error.
        given: A value, or a tuple of one or of as many as there are radars.
        radars: How many there are.

    Raises:
        PairingError: for another number of values.
    """
    values = given if isinstance(given, tuple) else (given,)
    if len(values) == 1 or not radars:
        return values[:1] * radars
    if len(values) != radars:
        raise PairingError(
            f"{name} needs one value for all radars or one for each of {radars}, got {len(values)}: {list(values)}"
        )
    return values


@dataclass(frozen=True)
class EarlierSweep(Generic[SweepT]):
    """A sweep before the nearest one.

    Attributes:
        sweep: As given to `Pairer.add_sweep`.
        offset_s: Its stamp, with `radar_time_offset_s`, minus the image's, in seconds.
    """

    sweep: SweepT
    offset_s: float


@dataclass(frozen=True)
class Pair(Generic[ImageT, SweepT]):
    """An image with what the radars saw nearest to it in time.

    Attributes:
        stamp_ns: The image's stamp.
        image: As given to `Pairer.add_image`.
        sweeps: Of each radar, in the order of the pairer's radars; None where it had none near enough.
        offsets_s: The sweep's stamp, with `radar_time_offset_s`, minus the image's, in seconds; None like the sweep.
        earlier: Of each radar the sweeps before that one, the newest first; empty where one sweep alone is wanted.
    """

    stamp_ns: int
    image: ImageT
    sweeps: tuple[SweepT | None, ...]
    offsets_s: tuple[float | None, ...]
    earlier: tuple[tuple[EarlierSweep[SweepT], ...], ...] = ()


@dataclass(frozen=True)
class RadarCounts:
    """What became of one radar's sweeps.

    Attributes:
        name: The radar, as given to the pairer.
        paired: Images released with a sweep of it.
        unmatched: Images released without one.
        late: Sweeps that would have been nearer to an image that was released before they came.
        duplicates: Sweeps dropped since another with the same stamp was there.
    """

    name: str
    paired: int
    unmatched: int
    late: int
    duplicates: int


@dataclass(frozen=True)
class PairingCounts:
    """What became of the images.

    Attributes:
        images: Images that came, without duplicates.
        waiting: Those of them that still wait.
        paired: Images released with a sweep of at least one radar.
        unmatched: Images released without any.
        overtaken: Images released after one with a later stamp, since they came after it.
        duplicates: Images dropped since another with the same stamp was there.
        resets: Backward jumps of the stamps: a looped bag, a reset clock.
        radars: The same for each radar.
    """

    images: int
    waiting: int
    paired: int
    unmatched: int
    overtaken: int
    duplicates: int
    resets: int
    radars: tuple[RadarCounts, ...]
