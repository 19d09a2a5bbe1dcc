from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from radcam_depth_ros.calibration import TimeReport
from radcam_depth_ros.calibration.recording import Recording
from radcam_depth_ros.calibration.signals import Signal, estimate_shift
from radcam_depth_ros.calibration.timing import check_times
from radcam_depth_ros.geometry import TransformTree
from radcam_depth_ros.motion import Motion


def late(recording: Recording, late_s: float, **changes: object) -> Recording:
    """The recording with a radar whose stamps are so much later."""
    (radar,) = recording.radars
    sweeps = tuple(dataclasses.replace(sweep, stamp_ns=sweep.stamp_ns + round(late_s * 1e9)) for sweep in radar.sweeps)
    changed = dataclasses.replace(radar, sweeps=sweeps, **changes)  # type: ignore[arg-type]  # as the caller has it
    return dataclasses.replace(recording, radars=(changed,))


def judged(recording: Recording, offset_s: float = 0.0) -> TimeReport:
    (report,) = check_times(recording, (offset_s,))
    return report


def without_odometry(recording: Recording) -> Recording:
    motion = Motion("/odom", is_odometry=True, transforms=TransformTree(), anchor="camera")
    return dataclasses.replace(recording, motion=motion, base_from_camera=None)


@pytest.mark.parametrize("with_odometry", [True, False])
@pytest.mark.parametrize("late_s", [0.0, 0.2, -0.12])
def test_a_clock_that_is_off_is_measured(posts: Recording, late_s: float, with_odometry: bool) -> None:
    recording = late(posts, late_s)
    report = judged(recording if with_odometry else without_odometry(recording))
    assert report.verdict == ("SUSPECT" if late_s else "OK"), report.sentence
    assert report.radar_time_offset_s is not None
    assert report.error_s is not None
    assert abs(report.radar_time_offset_s + late_s) < 2 * report.error_s
    assert report.error_s < 0.05
    assert ("radar_time_offset_s:" in report.sentence) == bool(late_s)


def test_the_offset_that_is_set_already_is_part_of_the_suggestion(posts: Recording) -> None:
    report = judged(late(posts, 0.2), 0.05)
    assert report.radar_time_offset_s == pytest.approx(0.05 - 0.2, abs=0.03)


def test_a_clock_of_the_odometry_is_not_taken_for_the_radars(posts: Recording) -> None:
    by_images = posts.image_yaw_rate
    shifted = Signal(by_images.times_s + 0.2, by_images.values)
    report = judged(dataclasses.replace(late(posts, 0.2), image_yaw_rate=shifted))
    assert report.verdict == "OK", report.sentence


def test_speeds_over_ground_tell_nothing(posts: Recording) -> None:
    report = judged(late(posts, 0.2, is_over_ground=True))
    assert (report.verdict, report.radar_time_offset_s) == ("UNKNOWN", None)
    assert "over ground" in report.sentence


def test_what_does_not_vary_tells_nothing() -> None:
    times_s, rng = np.arange(0.0, 10.0, 0.1), np.random.default_rng(1)
    steady = [Signal(times_s, 8.0 + rng.normal(0, 0.05, len(times_s))) for _ in range(2)]
    assert not estimate_shift(*steady).is_known
    slow = [Signal(times_s, 8.0 + 0.1 * times_s + rng.normal(0, 0.05, len(times_s))) for _ in range(2)]
    assert not estimate_shift(*slow).is_known
    assert not estimate_shift(Signal.of((), ()), steady[0]).is_known


@pytest.mark.parametrize("shift_s", [-0.3, 0.0, 0.17])
def test_a_shift_is_found_in_spite_of_outliers_and_another_scale(shift_s: float) -> None:
    rng = np.random.default_rng(2)
    times_s = np.arange(0.0, 12.0, 0.05)

    def speed(time_s: np.ndarray) -> np.ndarray:
        return 8 + 3 * np.sin(1.7 * time_s) + np.sin(0.6 * time_s)

    values = 1.1 * speed(times_s[::2] + shift_s) + 0.5 + rng.normal(0, 0.05, len(times_s[::2]))
    values[::9] = 0.0
    found = estimate_shift(Signal(times_s[::2], values), Signal(times_s, speed(times_s)))
    assert found.is_known, found.problem
    assert abs(found.seconds - shift_s) < 2 * found.error_s


def test_more_than_half_a_second_is_not_told() -> None:
    times_s = np.arange(0.0, 20.0, 0.05)
    first, second = (Signal(times_s, np.sin(0.9 * (times_s + late_s))) for late_s in (0.9, 0.0))
    assert not estimate_shift(first, second).is_known
