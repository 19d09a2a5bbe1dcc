"""By how much a radar's stamps are off from the camera's."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from radcam_depth_ros.calibration.own_motion import OwnMotion, own_motion
from radcam_depth_ros.calibration.recording import Radar, Recording
from radcam_depth_ros.calibration.report import OK, SUSPECT, UNKNOWN, ShiftFacts, TimeReport
from radcam_depth_ros.calibration.signals import LARGEST_SHIFT_S, Shift, Signal, estimate_shift
from radcam_depth_ros.geometry import DoubleArray

_SUSPECT_S = 0.04
"""A sweep is taken over so long; less is not worth a word."""
_CERTAIN = 3.0
_STEP_NS = 20_000_000
_HALF_WINDOW_NS = 40_000_000
_SECOND = 1_000_000_000


def judge_times(recording: Recording, offsets_s: Sequence[float]) -> tuple[TimeReport, ...]:
    """Of each radar, by how much its stamps are off.

    Its speed over ground by Doppler is compared with that of the odometry, whose clock is to be the camera's, and its
    sideways motion in turns with how the images turn. Where images and odometry can be compared, that is corrected for.

    Args:
        recording: The drive.
        offsets_s: `radar_time_offset_s` of each radar, with which it was read.
    """
    speed, yaw_rate = _odometry(recording)
    camera = estimate_shift(recording.image_motion.yaw_rate, yaw_rate)
    return tuple(
        _judge(recording, radar, offset_s, speed, camera)
        for radar, offset_s in zip(recording.radars, offsets_s, strict=True)
    )


def _judge(recording: Recording, radar: Radar, offset_s: float, speed: Signal, camera: Shift) -> TimeReport:
    facts: list[ShiftFacts] = []
    if radar.is_over_ground or not any(np.isfinite(sweep.radial_speed_mps).any() for sweep in radar.sweeps):
        sentence = "its radial speeds are none, or over ground already, so they do not tell how it moves"
        return TimeReport(radar.topic, UNKNOWN, sentence, None, None, ())
    own = [own_motion(sweep.xyz_m, sweep.radial_speed_mps) for sweep in radar.sweeps]
    times_s = [sweep.stamp_ns / _SECOND for sweep in radar.sweeps]
    by_speed = estimate_shift(Signal.of(times_s, [_speed(one) for one in own]), speed)
    facts.append(_facts("radar to odometry, by speed", by_speed))
    right = radar.camera_from_radar.matrix[0]
    sideways = Signal.of(times_s, [np.nan if one is None else -float(right @ one.velocity_mps) for one in own])
    by_turn = estimate_shift(sideways, recording.image_motion.yaw_rate)
    facts.append(_facts("radar to camera, by turning", by_turn))
    facts.append(_facts("camera to odometry, by turning", camera))
    found: list[tuple[float, float]] = []
    assumed = ""
    if by_speed.is_known:
        # What the camera's stamps are off from the odometry's is not the radar's fault.
        known = camera.is_known
        seconds = by_speed.seconds - (camera.seconds if known else 0.0)
        found.append((seconds, math.hypot(by_speed.error_s, camera.error_s if known else 0.0)))
        assumed = "" if known else ", if the odometry's clock is the camera's"
    if by_turn.is_known:
        found.append((by_turn.seconds, by_turn.error_s))
        assumed = ""
    if not found:
        sentence = (
            f"cannot be told: radar and odometry by their speed: {by_speed.problem}; radar and camera by turning: "
            f"{by_turn.problem}; record some braking and some turns, with odometry"
        )
        return TimeReport(radar.topic, UNKNOWN, sentence, None, None, tuple(facts))
    seconds, error_s = min(found, key=lambda item: item[1])
    if len(found) == 2 and abs(found[0][0] - found[1][0]) > _CERTAIN * math.hypot(found[0][1], found[1][1]):
        sentence = (
            f"cannot be told: by speed the stamps have to be shifted by {found[0][0]:+.3f} s, by turning by "
            f"{found[1][0]:+.3f} s"
        )
        return TimeReport(radar.topic, UNKNOWN, sentence, None, None, tuple(facts))
    value, rounded_error = round(offset_s + seconds, 3), round(error_s, 3)
    if abs(seconds) > max(_SUSPECT_S, _CERTAIN * error_s):
        sentence = (
            f"its stamps are {abs(seconds):.3f} s too {'late' if seconds < 0 else 'early'} (+- {error_s:.3f}){assumed}; "
            f"set radar_time_offset_s: {value:g}"
        )
        return TimeReport(radar.topic, SUSPECT, sentence, value, rounded_error, tuple(facts))
    sentence = f"its stamps fit the camera's: {seconds:+.3f} s (+- {error_s:.3f}){assumed}"
    return TimeReport(radar.topic, OK, sentence, value, rounded_error, tuple(facts))


def _odometry(recording: Recording) -> tuple[Signal, Signal]:
    """Speed, m/s, and turning to the left, rad/s, of the vehicle."""
    times_s: list[float] = []
    speeds: list[float] = []
    yaw_rates: list[float] = []
    stamps = [sweep.stamp_ns for radar in recording.radars for sweep in radar.sweeps]
    stamps += [view.frame.stamp_ns for view in recording.views]
    margin_ns = round(LARGEST_SHIFT_S * _SECOND)
    for stamp_ns in range(min(stamps) - margin_ns, max(stamps) + margin_ns, _STEP_NS):
        before, after = (recording.motion.at(stamp_ns + sign * _HALF_WINDOW_NS) for sign in (-1, 1))
        if before is None or after is None:
            continue
        moved = before.inverse() @ after
        elapsed_s = 2 * _HALF_WINDOW_NS / _SECOND
        times_s.append(stamp_ns / _SECOND)
        speeds.append(float(np.linalg.norm(moved.translation)) / elapsed_s)
        yaw_rates.append(_yaw(moved.rotation) / elapsed_s)
    return Signal.of(times_s, speeds), Signal.of(times_s, yaw_rates)


def _yaw(rotation: DoubleArray) -> float:
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def _speed(own: OwnMotion | None) -> float:
    return math.nan if own is None else own.speed_mps


def _facts(what: str, shift: Shift) -> ShiftFacts:
    def rounded(value: float) -> float | None:
        return round(value, 4) if math.isfinite(value) else None

    seconds = rounded(shift.seconds) if shift.is_known else None
    return ShiftFacts(what, seconds, rounded(shift.error_s), rounded(shift.correlation), shift.problem)
