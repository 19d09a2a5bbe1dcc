"""Results of a calibration check."""

from __future__ import annotations

from dataclasses import dataclass

OK, SUSPECT, UNKNOWN = "OK", "SUSPECT", "UNKNOWN"


@dataclass(frozen=True)
class Fit:
    """Scores of a candidate pose.

    Attributes:
        name: The pose, in words.
        score: 0 to 1; 1 where no other pose has a better score in any part.
        view: Share of the points in the image; None where unknown, as all that follow.
        road: Share of the points that are not below the road, nor high above it.
        lidar: Nearness to the LiDAR's points seen from above, 1 on them, 0 at 2 m.
        doppler: Share of the static returns whose Doppler agrees with the vehicle's motion.
        sweeps: Nearness to returns of other sweeps, moved by odometry, minus that by chance.
    """

    name: str
    score: float
    view: float | None = None
    road: float | None = None
    lidar: float | None = None
    doppler: float | None = None
    sweeps: float | None = None


@dataclass(frozen=True)
class SensorReport:
    """The result for a sensor's pose.

    Attributes:
        topic: Its topic.
        verdict: OK, SUSPECT or UNKNOWN.
        sentence: Why, and what to do.
        images: Number of images that were used.
        points: Of them, in all.
        given: The given pose.
        alternatives: The other poses with the best scores, the best first.
        undecided: Others that fit as well.
        yaw_off_deg: By how much it has to be turned to the left, by Doppler; None where unknown.
        yaw_error_deg: The standard deviation of that.
    """

    topic: str
    verdict: str
    sentence: str
    images: int
    points: int
    given: Fit | None = None
    alternatives: tuple[Fit, ...] = ()
    undecided: tuple[str, ...] = ()
    yaw_off_deg: float | None = None
    yaw_error_deg: float | None = None


@dataclass(frozen=True)
class ShiftFacts:
    """By how much the stamps of one sensor have to be shifted to fit another.

    Attributes:
        what: The two sensors, and the compared quantity.
        seconds: To be added to the first one's stamps; None where it cannot be told.
        error_s: The standard deviation of that.
        correlation: Of the two, once shifted.
        problem: Why it cannot be told; empty where it can.
    """

    what: str
    seconds: float | None
    error_s: float | None
    correlation: float | None
    problem: str = ""


@dataclass(frozen=True)
class TimeReport:
    """The result for a radar's clock.

    Attributes:
        topic: The radar.
        verdict: OK, SUSPECT or UNKNOWN.
        sentence: Why, and what to do.
        radar_time_offset_s: What the parameter should be; None where unknown.
        error_s: The standard deviation of that.
        shifts: The shifts that it was computed from.
    """

    topic: str
    verdict: str
    sentence: str
    radar_time_offset_s: float | None
    error_s: float | None
    shifts: tuple[ShiftFacts, ...]


@dataclass(frozen=True)
class Report:
    """The result of a calibration check.

    Attributes:
        bag: Where the bag is.
        seconds: How long it is.
        seconds_read: How much of that was read.
        verdict: SUSPECT where anything is, UNKNOWN where a radar's place is, else OK.
        sensors: The places of the radars and the LiDAR.
        times: The radars' clocks.
        road_is_known: Whether the camera's height is known; else it is assumed.
        pictures: The files that were written.
    """

    bag: str
    seconds: float
    seconds_read: float
    verdict: str
    sensors: tuple[SensorReport, ...]
    times: tuple[TimeReport, ...]
    road_is_known: bool
    pictures: tuple[str, ...] = ()
