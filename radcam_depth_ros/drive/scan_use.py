"""Records how LiDAR scans became ground truth: moved to their image's time, as they lie, or left out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

MOVED, AS_IT_LIES, LEFT_OUT = "moved", "as_it_lies", "left_out"


@dataclass(frozen=True)
class ScanUse:
    """How the scan nearest to an image was used.

    Attributes:
        use: `moved` to the image's time, `as_it_lies` where the bag does not tell the vehicle's motion, or `left_out`
            where it does, but not for this scan or image.
        offset_s: The scan's stamp less the image's, seconds.
        shift_m: How far the vehicle drove in between, metres: by its poses, else by the radars' Doppler; NaN unknown.
        reason: Why it was left out; else empty.
    """

    use: str
    offset_s: float
    shift_m: float = math.nan
    reason: str = ""


@dataclass(frozen=True)
class ScanGroup:
    """Scans that were used in one way.

    Attributes:
        scans: How many.
        offset_s: Mean time between a scan and its image, seconds; NaN without scans.
        max_offset_s: The longest.
        known_shifts: Of how many `shift_m` is known.
        shift_m: How far the vehicle drove in between, on average of those of which it is known; NaN without.
    """

    scans: int = 0
    offset_s: float = math.nan
    max_offset_s: float = math.nan
    known_shifts: int = 0
    shift_m: float = math.nan

    @classmethod
    def of(cls, uses: Iterable[ScanUse]) -> ScanGroup:
        """The group of single scans."""
        alone = (
            cls(1, abs(use.offset_s), abs(use.offset_s), int(not math.isnan(use.shift_m)), use.shift_m) for use in uses
        )
        return cls.joined(alone)

    @classmethod
    def joined(cls, groups: Iterable[ScanGroup]) -> ScanGroup:
        """Several groups as one."""
        groups = [group for group in groups if group.scans]
        scans, shifts = sum(group.scans for group in groups), sum(group.known_shifts for group in groups)
        if not scans:
            return cls()
        offset_s = sum(group.scans * group.offset_s for group in groups) / scans
        shift_m = sum(group.known_shifts * group.shift_m for group in groups if group.known_shifts)
        max_offset_s = max(group.max_offset_s for group in groups)
        return cls(scans, offset_s, max_offset_s, shifts, shift_m / shifts if shifts else math.nan)

    def as_json(self) -> dict[str, object]:
        """Plain values; null where there is no number."""
        return {
            "scans": self.scans,
            "mean_offset_ms": _number(1e3 * self.offset_s),
            "max_offset_ms": _number(1e3 * self.max_offset_s),
            "mean_shift_m": _number(self.shift_m),
        }

    @property
    def speed_mps(self) -> float:
        """The vehicle's mean speed; NaN where it is not known."""
        return self.shift_m / self.offset_s if self.known_shifts and self.offset_s else math.nan

    @property
    def apart(self) -> str:
        """How far they are from their images, for a sentence."""
        return f"{1e3 * self.offset_s:.0f} ms from their images on average, {1e3 * self.max_offset_s:.0f} at most"

    @property
    def shift(self) -> str:
        """How much that matters, for a sentence."""
        if self.known_shifts:
            return f"in which the vehicle drove {self.shift_m:.2f} m on average, at {self.speed_mps:.1f} m/s"
        return f"in which a vehicle drives {10 * self.offset_s:.2f} m at 10 m/s; its speed is not known"


@dataclass(frozen=True)
class ScanSummary:
    """How the scans of one or several drives were used.

    Attributes:
        moved: Those moved to their image's time.
        as_they_lie: Those taken as they lie.
        left_out: Those that could not be moved.
        reason: Why the last one was left out; empty where none was.
    """

    moved: ScanGroup = ScanGroup()
    as_they_lie: ScanGroup = ScanGroup()
    left_out: ScanGroup = ScanGroup()
    reason: str = ""

    @classmethod
    def of(cls, uses: Iterable[ScanUse]) -> ScanSummary:
        """Sums up single scans."""
        uses = list(uses)
        return cls(
            ScanGroup.of(use for use in uses if use.use == MOVED),
            ScanGroup.of(use for use in uses if use.use == AS_IT_LIES),
            ScanGroup.of(use for use in uses if use.use == LEFT_OUT),
            next((use.reason for use in reversed(uses) if use.reason), ""),
        )

    @classmethod
    def joined(cls, summaries: Iterable[ScanSummary]) -> ScanSummary:
        """Those of several drives as one."""
        summaries = list(summaries)
        return cls(
            ScanGroup.joined(summary.moved for summary in summaries),
            ScanGroup.joined(summary.as_they_lie for summary in summaries),
            ScanGroup.joined(summary.left_out for summary in summaries),
            next((summary.reason for summary in reversed(summaries) if summary.reason), ""),
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> ScanSummary:
        """What `dataclasses.asdict` made a mapping of."""
        moved, as_they_lie, left_out = (ScanGroup(**values[name]) for name in ("moved", "as_they_lie", "left_out"))
        return cls(moved, as_they_lie, left_out, str(values["reason"]))

    @property
    def scans(self) -> int:
        """How many there are."""
        return self.moved.scans + self.as_they_lie.scans + self.left_out.scans

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to know of them, none without scans."""
        found = []
        if self.moved.scans:
            group = self.moved
            found.append(f"{group.scans} moved to their images' time: {group.apart}, {group.shift}")
        if self.as_they_lie.scans:
            group = self.as_they_lie
            by_doppler = " by the radars' Doppler" if group.known_shifts else ""
            found.append(
                f"{group.scans} taken as they lie, since nothing tells how the vehicle moved (no odometry, no link on "
                f"/tf): {group.apart}, {group.shift}{by_doppler}"
            )
        if self.left_out.scans:
            found.append(f"{self.left_out.scans} left out, since they could not be moved: {self.reason}")
        return tuple(found)

    def as_json(self) -> dict[str, object]:
        """Plain values."""
        return {
            "moved": self.moved.as_json(),
            "as_they_lie": self.as_they_lie.as_json(),
            "left_out": {**self.left_out.as_json(), "reason": self.reason},
        }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
