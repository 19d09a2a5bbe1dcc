"""What pairing takes and gives: limits, pairs, counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

from radcam_depth_ros.frame import RadcamDepthError

ImageT = TypeVar("ImageT")
SweepT = TypeVar("SweepT")


class PairingError(RadcamDepthError):
    """A pairing that cannot work as configured, or a radar that it does not know."""


@dataclass(frozen=True)
class PairingConfig:
    """How images and radar sweeps are paired.

    Attributes:
        max_time_offset_s: A sweep further away from the image than this, in seconds, is not taken.
        max_wait_s: So long, in seconds, an image waits at most for a nearer sweep.
        radar_time_offset_s: Added to the stamps of all radars, in seconds; negative where they are stamped too late.
    """

    max_time_offset_s: float = 0.1
    max_wait_s: float = 0.1
    radar_time_offset_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("max_time_offset_s", "max_wait_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise PairingError(f"{name} must be 0 or a positive number of seconds, got {value}")
        if not math.isfinite(self.radar_time_offset_s):
            raise PairingError(f"radar_time_offset_s must be a number of seconds, got {self.radar_time_offset_s}")


@dataclass(frozen=True)
class Pair(Generic[ImageT, SweepT]):
    """An image with what the radars saw nearest to it in time.

    Attributes:
        stamp_ns: The image's stamp.
        image: As given to `Pairer.add_image`.
        sweeps: Of each radar, in the order of the pairer's radars; None where it had none near enough.
        offsets_s: The sweep's stamp, with `radar_time_offset_s`, minus the image's, in seconds; None like the sweep.
    """

    stamp_ns: int
    image: ImageT
    sweeps: tuple[SweepT | None, ...]
    offsets_s: tuple[float | None, ...]


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
