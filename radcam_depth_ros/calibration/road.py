"""Estimates a camera's height above the road, pitch and roll over a whole drive."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN
from radcam_depth_ros.calibration.road_plane import PlaneEstimate, Pooled, fit_plane, pool
from radcam_depth_ros.calibration.road_reading import BEST_TRAVEL_M, RoadReading
from radcam_depth_ros.calibration.road_texture import TextureError, TexturePair
from radcam_depth_ros.drive import DriveSettings
from radcam_depth_ros.frame import GroundPlane

ROAD_FRAMES = 40
PARAMETERS = ("camera_height_m", "camera_pitch_deg", "camera_roll_deg")
LIDAR, TEXTURE = "lidar", "texture"
_LIDAR_FLOORS, _TEXTURE_FLOORS = (0.005, 0.05, 0.05), (0.01, 0.1, 0.4)
"""Least standard deviations: height as a share, pitch and roll in degrees."""
_LARGEST = (0.08, 0.6, 1.5)
"""What is known no better than that is not told; likewise."""
_TOLERANCES = (0.05, 0.5, 1.0)
"""What differs by less than this, or three standard deviations, is the same; likewise."""
_HEIGHTS_M = np.geomspace(0.45, 5.0, 34)
_LEAST_PROMINENCE = 0.025
_LESSER_PEAK = 0.5
_WIDEST_PEAK = 1.6
"""A peak as wide as this factor of height, at half its rise, tells no height."""
_LARGEST_SPREAD = 0.2
_LEAST_WAY_M = 1.0
"""From the first pair of images to the last one: less shows only one place of the road."""


@dataclass(frozen=True)
class RoadValue:
    """One of the node's parameters.

    Attributes:
        parameter: Its name.
        value: What the drive says; None where unknown.
        deviation: The standard deviation of that.
        given: What the bag's transforms, or the parameters, say; None where they do not.
        verdict: OK, SUSPECT or UNKNOWN.
        sentence: `fits`, `off by ...`, or why it is unknown.
    """

    parameter: str
    value: float | None
    deviation: float | None
    given: float | None
    verdict: str
    sentence: str


@dataclass(frozen=True)
class RoadReport:
    """A camera's place above the road.

    Attributes:
        bag: Where the bag is.
        verdict: SUSPECT where a value is, UNKNOWN where one is unknown, else OK.
        sentence: Why it is unknown; empty where it is not.
        source: `lidar`, `texture+odometry` or `texture+doppler`; empty where nothing tells.
        frames: How many scans or pairs of images were used.
        looked_at: How many were looked at.
        values: Height, pitch and roll.
    """

    bag: str
    verdict: str
    sentence: str
    source: str
    frames: int
    looked_at: int
    values: tuple[RoadValue, ...]


def check_road(
    bag: Path | str,
    settings: DriveSettings | None = None,
    *,
    frames: int = ROAD_FRAMES,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> RoadReport:
    """Estimates a camera's height above the road, pitch and roll.

    By the LiDAR where the bag has one, else by the motion of the road's texture.

    Args:
        bag: A rosbag2 folder or .mcap file.
        settings: How it is read.
        frames: So many scans or pairs of images are looked at, evenly spread.
        progress: Called with (stage, done, to do).

    Raises:
        RadcamDepthError: for a bag that cannot be used.
    """
    with BagReader(bag) as reader:
        reading = RoadReading(reader, settings or DriveSettings())
        scans: list[PlaneEstimate | None] = []
        for points_m in reading.scans(frames):
            scans.append(fit_plane(points_m))
            progress("scans", len(scans), frames)
        found = [estimate for estimate in scans if estimate is not None]
        pooled = pool(found, _LIDAR_FLOORS)
        if pooled is not None:
            return _report(bag, reading.ground, pooled, LIDAR, len(scans), "")
        estimates, looked_at, sentence = _by_texture(reading, frames, progress)
        if scans and sentence:
            sentence = f"no scan has enough points on the road, and {sentence}"
        source = f"{TEXTURE}+{reading.source}" if reading.source else ""
        if estimates and reading.travelled_m < _LEAST_WAY_M:
            estimates, sentence = [], "the vehicle hardly moves"
        height_floor, pitch_floor, roll_floor = _TEXTURE_FLOORS
        floors = (math.hypot(height_floor, reading.travel_error), pitch_floor, roll_floor)
        pooled = pool(estimates, floors, reading.travelled_m / BEST_TRAVEL_M)
        return _report(bag, reading.ground, pooled, source, looked_at, sentence)


def _by_texture(
    reading: RoadReading, frames: int, progress: Callable[[str, int, int], None]
) -> tuple[list[PlaneEstimate], int, str]:
    """Estimates of the pairs, how many were looked at, and why there are none; empty where there are."""
    pairs: list[TexturePair] = []
    scores, problems, looked_at = [], Counter[str](), 0
    for images in reading.pairs(frames):
        looked_at += 1
        try:
            pair = TexturePair(images.first, images.second, images.camera, images.distance_m)
        except TextureError as error:
            problems[str(error)] += 1
        else:
            scores.append(pair.scores(_HEIGHTS_M))
            pairs.append(pair)
        progress("pairs of images", looked_at, frames)
    if not looked_at:
        why = "the vehicle hardly moves" if reading.source else "no odometry, /tf or Doppler tells how far it moves"
        return [], 0, why
    height_m = likely_height_m(np.array(scores)) if scores else None
    if height_m is None:
        problems["the road has too little texture, or it is too dark"] += len(pairs)
        return [], looked_at, problems.most_common(1)[0][0]
    estimates: list[PlaneEstimate] = []
    for number, pair in enumerate(pairs):
        try:
            estimates.append(pair.fit(height_m))
        except TextureError as error:
            problems[str(error)] += 1
        progress("road", number + 1, len(pairs))
    kept = [
        estimate
        for estimate in estimates
        if abs(math.log(estimate.height_m / height_m)) < math.log(1.3)
        and estimate.deviations[0] < _LARGEST_SPREAD * estimate.height_m
    ]
    return kept, looked_at, problems.most_common(1)[0][0] if problems else ""


def likely_height_m(scores: np.typing.NDArray[np.float64]) -> float | None:
    """The height at which the images of all pairs fit best; None where no height is better than others.

    Args:
        scores: (pairs, heights) of `TexturePair.scores`.
    """
    mean = scores.mean(axis=0)
    rise = mean - np.median(mean)
    peaks = [
        place for place in range(1, len(rise) - 1) if rise[place] >= rise[place - 1] and rise[place] >= rise[place + 1]
    ]
    high = [place for place in peaks if rise[place] > _LEAST_PROMINENCE]
    if not high:
        return None
    # What stands on the road seems nearer than the road: of several peaks the lowest plane's is the road's.
    best = max(place for place in high if rise[place] > _LESSER_PEAK * max(rise[high]))
    low = top = best
    while low > 0 and rise[low - 1] > rise[best] / 2:
        low -= 1
    while top < len(rise) - 1 and rise[top + 1] > rise[best] / 2:
        top += 1
    # Between two peaks there may be no valley that deep: the steeper side tells.
    width = min(_HEIGHTS_M[top] / _HEIGHTS_M[best], _HEIGHTS_M[best] / _HEIGHTS_M[low]) ** 2
    return float(_HEIGHTS_M[best]) if width < _WIDEST_PEAK else None


def _report(
    bag: Path | str, ground: GroundPlane, pooled: Pooled | None, source: str, looked_at: int, sentence: str
) -> RoadReport:
    given = _given(ground)
    if pooled is not None and pooled.spreads[0] > _LARGEST_SPREAD * pooled.numbers[0]:
        sentence, pooled = "its measurements differ too much from one another", None
    if pooled is None:
        sentence = sentence or "too few frames show the road"
        unknown = tuple(
            RoadValue(name, None, None, value, UNKNOWN, sentence) for name, value in zip(PARAMETERS, given, strict=True)
        )
        return RoadReport(str(bag), UNKNOWN, sentence, source, 0, looked_at, unknown)
    values = tuple(_value(index, pooled, given[index]) for index in range(len(PARAMETERS)))
    verdicts = [value.verdict for value in values]
    verdict = next((name for name in (SUSPECT, UNKNOWN) if name in verdicts), OK)
    told = "; ".join(value.sentence for value in values if value.verdict == UNKNOWN)
    return RoadReport(str(bag), verdict, told, source, pooled.count, looked_at, values)


def _given(ground: GroundPlane) -> tuple[float | None, ...]:
    if not ground.is_known or ground.is_assumed:
        return None, None, None
    right, down, forward = ground.up
    return ground.height_m, math.degrees(-math.asin(forward)), math.degrees(math.atan2(-right, -down))


def _value(index: int, pooled: Pooled, given: float | None) -> RoadValue:
    name, value, deviation = PARAMETERS[index], pooled.numbers[index], pooled.deviations[index]
    unit = pooled.numbers[0] if index == 0 else 1.0
    if deviation > _LARGEST[index] * unit:
        sentence = f"{name} is known to no better than {deviation:.2f}"
        return RoadValue(name, None, round(deviation, 4), given, UNKNOWN, sentence)
    value, deviation = round(value, 4), round(deviation, 4)
    if given is None:
        return RoadValue(name, value, deviation, None, OK, "nothing to compare with")
    off = given - value
    if abs(off) <= max(_TOLERANCES[index] * unit, 3 * deviation):
        return RoadValue(name, value, deviation, round(given, 4), OK, "fits")
    return RoadValue(
        name, value, deviation, round(given, 4), SUSPECT, f"off by {off:+.2f} {'m' if index == 0 else 'degrees'}"
    )
