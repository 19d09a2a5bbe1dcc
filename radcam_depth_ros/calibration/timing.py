"""Estimates the time offset between radar and camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.calibration.evidence import floor_axes
from radcam_depth_ros.calibration.recording import Radar, Recording
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN, ShiftFacts, TimeReport
from radcam_depth_ros.calibration.signals import LARGEST_SHIFT_S, Shift, Signal, estimate_shift
from radcam_depth_ros.geometry import DoubleArray, RigidTransform

_SUSPECT_S = 0.04
"""Duration of a sweep; smaller offsets are not reported."""
_CERTAIN = 3.0
_IMAGE_ERROR_S = 0.02
"""Least error of a shift that is estimated from images."""
_STEP_NS = 20_000_000
_HALF_WINDOW_NS = 40_000_000
_SECOND = 1_000_000_000


def check_times(recording: Recording, offsets_s: Sequence[float]) -> tuple[TimeReport, ...]:
    """Of each radar, by how much its stamps are off.

    Its speed over ground by Doppler is compared with that of the odometry, whose clock is to be the camera's, and its
    sideways motion in turns with how the images turn. Where the images show another clock than the odometry's, that is
    corrected for.

    Args:
        recording: The drive.
        offsets_s: `radar_time_offset_s` of each radar, with which it was read.
    """
    steps = _steps(recording)
    yaw_rate = Signal.of(
        [step.time_s for step in steps], [_yaw(step.moved.rotation) / step.elapsed_s for step in steps]
    )
    camera = estimate_shift(recording.image_yaw_rate, yaw_rate, _IMAGE_ERROR_S)
    return tuple(
        _judge(recording, radar, offset_s, steps, camera)
        for radar, offset_s in zip(recording.radars, offsets_s, strict=True)
    )


@dataclass(frozen=True)
class _Step:
    """How the vehicle moved around a time, in its own axes before."""

    time_s: float
    elapsed_s: float
    moved: RigidTransform


def _judge(recording: Recording, radar: Radar, offset_s: float, steps: Sequence[_Step], camera: Shift) -> TimeReport:
    facts: list[ShiftFacts] = []

    def unknown(sentence: str) -> TimeReport:
        return TimeReport(radar.topic, UNKNOWN, sentence, None, None, tuple(facts))

    if radar.is_over_ground or not any(np.isfinite(sweep.radial_speed_mps).any() for sweep in radar.sweeps):
        return unknown("its radial speeds are none, or over ground already, so they do not tell how it moves")
    times_s = [sweep.stamp_ns / _SECOND for sweep in radar.sweeps]
    own_speed = Signal.of(times_s, [math.nan if own is None else own.speed_mps for own in radar.own_motions])
    by_speed = estimate_shift(own_speed, _speed(recording, radar, steps))
    facts.append(_facts("radar to odometry, by speed", by_speed))
    by_turn = estimate_shift(_sideways(recording, radar, times_s), recording.image_yaw_rate, _IMAGE_ERROR_S)
    facts.append(_facts("radar to camera, by turning", by_turn))
    facts.append(_facts("camera to odometry, by turning", camera))
    found: list[tuple[float, float]] = []
    assumed = ""
    if by_speed.is_known:
        # The odometry's clock is to be the camera's; where the images say that it is not, the radar is not to blame.
        if camera.is_known and abs(camera.seconds) > _CERTAIN * camera.error_s:
            found.append((by_speed.seconds - camera.seconds, math.hypot(by_speed.error_s, camera.error_s)))
        else:
            found.append((by_speed.seconds, by_speed.error_s))
            assumed = "" if camera.is_known else ", if the odometry's clock is the camera's"
    if by_turn.is_known:
        found.append((by_turn.seconds, by_turn.error_s))
        assumed = ""
    if not found:
        return unknown(
            f"cannot be told: radar and odometry by their speed: {by_speed.problem}; radar and camera by turning: "
            f"{by_turn.problem}; record some braking and some turns, with odometry"
        )
    seconds, error_s = min(found, key=lambda item: item[1])
    if len(found) == 2 and abs(found[0][0] - found[1][0]) > _CERTAIN * math.hypot(found[0][1], found[1][1]):
        return unknown(
            f"cannot be told: by speed the stamps have to be shifted by {found[0][0]:+.3f} s, by turning by "
            f"{found[1][0]:+.3f} s"
        )
    value, rounded_error = round(offset_s + seconds, 3), round(error_s, 3)
    if abs(seconds) > max(_SUSPECT_S, _CERTAIN * error_s):
        sentence = (
            f"its stamps are {abs(seconds):.3f} s too {'late' if seconds < 0 else 'early'} (+- {error_s:.3f})"
            f"{assumed}; set radar_time_offset_s: {value:g}"
        )
        return TimeReport(radar.topic, SUSPECT, sentence, value, rounded_error, tuple(facts))
    sentence = f"its stamps fit the camera's: {seconds:+.3f} s (+- {error_s:.3f}){assumed}"
    return TimeReport(radar.topic, OK, sentence, value, rounded_error, tuple(facts))


def _steps(recording: Recording) -> tuple[_Step, ...]:
    """The vehicle's motion by odometry, from before the first message that is used to after the last."""
    stamps = [sweep.stamp_ns for radar in recording.radars for sweep in radar.sweeps]
    stamps += [view.frame.stamp_ns for view in recording.views]
    margin_ns = round(LARGEST_SHIFT_S * _SECOND)
    found: list[_Step] = []
    for stamp_ns in range(min(stamps) - margin_ns, max(stamps) + margin_ns, _STEP_NS):
        before, after = (recording.motion.at(stamp_ns + sign * _HALF_WINDOW_NS) for sign in (-1, 1))
        if before is not None and after is not None:
            found.append(_Step(stamp_ns / _SECOND, 2 * _HALF_WINDOW_NS / _SECOND, before.inverse() @ after))
    return tuple(found)


def _speed(recording: Recording, radar: Radar, steps: Sequence[_Step]) -> Signal:
    """m/s over ground of a radar, by odometry: in a turn it is not the vehicle's."""
    place_m = np.zeros(3)
    if recording.base_from_camera is not None:
        base_from_camera = recording.base_from_camera
        place_m = base_from_camera.rotation @ radar.camera_from_radar.translation_m + base_from_camera.translation
    ways = [step.moved.rotation @ place_m + step.moved.translation - place_m for step in steps]
    speeds = [float(np.linalg.norm(way)) / step.elapsed_s for way, step in zip(ways, steps, strict=True)]
    return Signal.of([step.time_s for step in steps], speeds)


def _sideways(recording: Recording, radar: Radar, times_s: Sequence[float]) -> Signal:
    """m/s to the left of the way that a radar mostly goes, by Doppler: in a turn its place swings out."""
    axes = floor_axes(recording.views[0].frame.ground.or_assumed()) @ radar.camera_from_radar.matrix
    velocities = np.array([(np.nan,) * 2 if own is None else axes @ own.velocity_mps for own in radar.own_motions])
    known = np.isfinite(velocities).all(axis=1)
    if not known.any():
        return Signal.of((), ())
    ahead = np.median(velocities[known], axis=0)
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
    to_left = ahead[0] * velocities[:, 1] - ahead[1] * velocities[:, 0]
    return Signal.of(times_s, to_left.tolist())


def _yaw(rotation: DoubleArray) -> float:
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def _facts(what: str, shift: Shift) -> ShiftFacts:
    def rounded(value: float) -> float | None:
        return round(value, 4) if math.isfinite(value) else None

    seconds = rounded(shift.seconds) if shift.is_known else None
    return ShiftFacts(what, seconds, rounded(shift.error_s), rounded(shift.correlation), shift.problem)
