"""Verdict on a sensor's given pose from the scores of all candidates."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from radcam_depth_ros.calibration.evidence import PARTS, Evidence, floor_axes, velocity_mps
from radcam_depth_ros.calibration.placements import Placement
from radcam_depth_ros.calibration.recording import Radar, Recording
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN, Fit, SensorReport
from radcam_depth_ros.geometry import DoubleArray

MARGIN = 0.05
"""A turn of 90 degrees or a flip counts as better, or as worse, when the scores differ by more than this."""
_SMALL_MARGIN = 0.04
_CERTAIN = 3.0
"""A difference counts when it is so many times its standard error over the images."""
_LEAST_PART = 0.1
_WEAK = ("view", "road")
"""Slopes, and returns that are missing on one side, change these as well."""
_WITNESS, _WEAK_WITNESS = 0.1, 0.2
"""One of the parts has to gain so much for a turn of 90 degrees or a flip to be called better."""
_FEWEST_IMAGES = 3
_SHOWN = 5
_YAW_SUSPECT_DEG = 2.0
_YAW_FLOOR_DEG = 0.2
_LEAST_SPEED_MPS = 4.0
_FEWEST_SWEEPS = 8
_HARMLESS = ("with z flipped",)
"""Without elevation, or with a poor one, nobody can tell, and little depends on it."""


def scores_of(parts: DoubleArray) -> DoubleArray:
    """(placements, images) scores: the mean of the parts, each as a share of what the best place has of it.

    Args:
        parts: (placements, images, PARTS), NaN where unknown.
    """
    best = _best(_mean(parts, 1))
    return _mean(parts / np.where(best >= _LEAST_PART, best, np.nan), 2)


def check_radar(recording: Recording, index: int, evidence: Evidence, placements: Sequence[Placement]) -> SensorReport:
    """A verdict on a radar's place."""
    radar = recording.radars[index]
    points = sum(len(view.radar_m[index]) for view in recording.views)
    if len(evidence) < min(_FEWEST_IMAGES, len(recording.views)):
        sentence = f"{len(evidence)} of {len(recording.views)} images have returns of it; look at it with inspect"
        return SensorReport(radar.topic, UNKNOWN, sentence, len(evidence), points)
    yaw_deg, yaw_error_deg = yaw_off(recording, radar)
    would_tell = () if recording.camera_from_lidar is not None else ("LiDAR",)
    would_tell = (*would_tell, "odometry in turns")
    report = check_sensor(radar.topic, placements, evidence.parts(placements), points, PARTS, would_tell)
    least_deg = math.inf if yaw_error_deg is None else max(_YAW_SUSPECT_DEG, _CERTAIN * yaw_error_deg)
    if report.verdict != SUSPECT and yaw_deg is not None and abs(yaw_deg) > least_deg:
        sentence = (
            f"by Doppler and odometry the radar has to be turned by {abs(yaw_deg):.1f} degrees to the "
            f"{'left' if yaw_deg > 0 else 'right'} (+- {yaw_error_deg:.1f}); correct its transform by that"
        )
        report = dataclasses.replace(report, verdict=SUSPECT, sentence=sentence)
    return dataclasses.replace(report, yaw_off_deg=yaw_deg, yaw_error_deg=yaw_error_deg)


def check_sensor(
    topic: str,
    placements: Sequence[Placement],
    parts: DoubleArray,
    points: int,
    names: Sequence[str],
    would_tell: Sequence[str],
) -> SensorReport:
    """A verdict on the first of several places.

    Args:
        topic: The sensor's.
        placements: The given one, then the others.
        parts: (placements, images, names), 0 to 1, NaN where unknown.
        points: How many points were looked at.
        names: Of the parts.
        would_tell: What else a bag might have.
    """
    scores = scores_of(parts)
    means, shares = np.nan_to_num(_mean(scores, 1)), _mean(parts, 1)
    images = scores.shape[1]
    fits = [
        Fit(placement.name, _rounded(mean) or 0.0, **dict(zip(names, map(_rounded, share), strict=True)))
        for placement, mean, share in zip(placements, means, shares, strict=True)
    ]
    order = [int(place) for place in np.argsort(-means, kind="stable") if place]
    alternatives = tuple(fits[place] for place in order[:_SHOWN])
    told = [name for name, best in zip(names, _best(shares), strict=True) if best >= _LEAST_PART]

    def report(verdict: str, sentence: str, undecided: tuple[str, ...] = ()) -> SensorReport:
        return SensorReport(topic, verdict, sentence, images, points, fits[0], alternatives, undecided)

    best = _better(placements, scores, parts, names)
    if best is not None:
        # The simplest mistake of those that fit alike.
        alike = [
            place
            for place in range(1, len(placements))
            if placements[place].kind == placements[best].kind and means[place] > means[best] - 0.01
        ]
        best = alike[0] if placements[best].kind == "coarse" else best
        also = [placements[place].name for place in alike if place != best][:2]
        sentence = f"the points fit {_how_much(means[best] - means[0])} better {placements[best].name}"
        sentence += f" (or {' or '.join(also)})" if also and placements[best].kind == "coarse" else ""
        deciding = [name for name, gain in zip(names, shares[best] - shares[0], strict=True) if gain > MARGIN]
        sentence += f": {placements[best].advice}"
        if deciding == ["lidar"]:
            sentence += "; only the LiDAR says so, so it may as well be the LiDAR's transform that is wrong"
        return report(SUSPECT, sentence)
    undecided = tuple(
        placement.name
        for placement, mean in zip(placements, means, strict=True)
        if placement.kind == "coarse" and mean > means[0] - MARGIN
    )
    better = {placement.name for placement, mean in zip(placements, means, strict=True) if mean > means[0] + MARGIN}
    grave = [name for name in undecided if name not in _HARMLESS or name in better]
    if grave:
        hint = f"; a bag with {' or '.join(would_tell)} would tell" if would_tell else ""
        sentence = f"the points fit as well or better {' or '.join(grave[:3])}{hint}; look at the pictures"
        return report(UNKNOWN, sentence, undecided)
    sentence = f"no turn of 90 degrees and no flip fits as well (judged by {', '.join(told)})"
    if undecided:
        sentence += f", but for one: it is unknown whether the points belong {' or '.join(undecided)}"
    return report(OK, sentence, undecided)


def _better(
    placements: Sequence[Placement], scores: DoubleArray, parts: DoubleArray, names: Sequence[str]
) -> int | None:
    """The place that fits clearly better than the given one; None where none does."""
    is_weak = np.isin(names, _WEAK)
    # A small turn brings a few more returns into the image, or above the road, where none is needed.
    small_scores = scores_of(np.where(is_weak, np.nan, parts))
    shares = _mean(parts, 1)
    found, most = None, 0.0
    for place in range(1, len(placements)):
        is_small = placements[place].kind == "small"
        judged = small_scores if is_small else scores
        gain = judged[place] - judged[0]
        gain = gain[np.isfinite(gain)]
        if len(gain) < 2 or gain.mean() <= (_SMALL_MARGIN if is_small else MARGIN):
            continue
        if gain.mean() < _CERTAIN * gain.std(ddof=1) / math.sqrt(len(gain)):
            continue
        witness = shares[place] - shares[0] > np.where(is_weak, _WEAK_WITNESS, _WITNESS)
        if (is_small or witness.any()) and gain.mean() > most + 1e-9:
            found, most = place, float(gain.mean())
    return found


def _how_much(gain: float) -> str:
    return "far" if gain > 0.2 else "clearly" if gain > 0.1 else "somewhat"


def yaw_off(recording: Recording, radar: Radar) -> tuple[float | None, float | None]:
    """By how many degrees a radar has to be turned to the left so that Doppler and odometry agree, and the error."""
    axes = floor_axes(recording.views[0].frame.ground.or_assumed())
    found: list[float] = []
    for sweep, own in zip(radar.sweeps, radar.own_motions, strict=True):
        velocity = velocity_mps(recording, radar, sweep.stamp_ns) if own is not None else None
        if velocity is None or own is None or np.linalg.norm(velocity) < _LEAST_SPEED_MPS:
            continue
        if abs(own.speed_mps - np.linalg.norm(velocity)) > 0.1 * np.linalg.norm(velocity):
            continue
        true, measured = axes @ velocity, axes @ radar.camera_from_radar.matrix @ own.velocity_mps
        turn = math.atan2(measured[0] * true[1] - measured[1] * true[0], float(measured @ true))
        found.append(math.degrees(turn))
    if len(found) < _FEWEST_SWEEPS:
        return None, None
    middle = float(np.median(found))
    spread = 1.4826 * float(np.median(np.abs(np.array(found) - middle)))
    # Neighbouring sweeps see the same things and err alike.
    error = math.hypot(_YAW_FLOOR_DEG, spread / math.sqrt(len(found) / 4))
    return round(middle, 2), round(error, 2)


def _mean(values: DoubleArray, axis: int) -> DoubleArray:
    """Of what is known along an axis; NaN where nothing is."""
    known = np.isfinite(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    mean: DoubleArray = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return mean


def _best(shares: DoubleArray) -> DoubleArray:
    """(parts,) the most that any place has of each; -inf where nothing is known."""
    best: DoubleArray = np.where(np.isfinite(shares), shares, -np.inf).max(axis=0)
    return best


def _rounded(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
