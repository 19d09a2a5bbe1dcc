from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from calibration_drive import CAMERA_FROM_LIDAR, CAMERA_FROM_RADAR

from radcam_depth_ros.calibration import SensorReport
from radcam_depth_ros.calibration.evidence import LIDAR_PARTS, PARTS, Evidence, lidar_parts
from radcam_depth_ros.calibration.placements import OPTICAL_FROM_BODY, Placement, Pose, alternatives
from radcam_depth_ros.calibration.recording import Recording
from radcam_depth_ros.calibration.verdict import check_radar, check_sensor

UP = np.array([0.0, -1.0, 0.0])
TRUE = Pose.of(CAMERA_FROM_RADAR)


def turn(axis: int, quarters: int) -> np.ndarray:
    """A turn by so many times 90 degrees about x, y or z."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = 0.0
    matrix[second, first], matrix[first, second] = 1.0, -1.0
    return np.linalg.matrix_power(matrix, quarters)


def flip(axis: int) -> np.ndarray:
    return np.diag([-1.0 if place == axis else 1.0 for place in range(3)])


def placed(recording: Recording, pose: Pose) -> tuple[Recording, tuple[Placement, ...]]:
    """The recording with its radar placed so, and what is compared with that."""
    radar = dataclasses.replace(recording.radars[0], camera_from_radar=pose)
    ground = recording.views[0].frame.ground.or_assumed()
    return dataclasses.replace(recording, radars=(radar,)), alternatives(
        pose, np.asarray(ground.up), "camera_from_radar"
    )


def report_of(recording: Recording, pose: Pose) -> SensorReport:
    changed, placements = placed(recording, pose)
    return check_radar(changed, 0, Evidence(changed, 0), placements)


def without_lidar(recording: Recording) -> Recording:
    return dataclasses.replace(recording, camera_from_lidar=None)


def quick(recording: Recording) -> Recording:
    """Half of the images, a third of the sweeps: enough for what is far off."""
    (radar,) = recording.radars
    sparse = dataclasses.replace(radar, sweeps=radar.sweeps[::3], own_motions=radar.own_motions[::3])
    return dataclasses.replace(recording, radars=(sparse,), views=recording.views[::2])


def best_pose(report: SensorReport, pose: Pose) -> Pose:
    """The place that the sentence names."""
    return next(
        placement.pose
        for placement in alternatives(pose, UP, "camera_from_radar")
        if f"better {placement.name}" in report.sentence
    )


def test_right_extrinsics_are_ok(posts: Recording, simulated: Recording) -> None:
    for recording in (posts, simulated):
        report = report_of(recording, recording.radars[0].camera_from_radar)
        assert (report.verdict, report.images) == ("OK", len(recording.views)), report.sentence
        assert report.given is not None
        assert report.given.score > 0.95
    assert report_of(quick(without_lidar(posts)), TRUE).verdict == "OK"


@pytest.mark.parametrize("quarters", [1, 2, 3])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_every_turn_of_90_degrees_is_caught_and_undone(posts: Recording, axis: int, quarters: int) -> None:
    wrong = Pose(TRUE.matrix @ turn(axis, quarters), TRUE.translation_m)
    report = report_of(quick(posts), wrong)
    assert report.verdict == "SUSPECT", report.sentence
    # Up and down are told apart least; the rest has to be right.
    np.testing.assert_allclose(best_pose(report, wrong).matrix[:, :2], TRUE.matrix[:, :2], atol=0.1)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_flipped_axis_is_caught_and_named(posts: Recording, axis: int) -> None:
    report = report_of(quick(posts), Pose(TRUE.matrix @ flip(axis), TRUE.translation_m))
    assert report.verdict == "SUSPECT"
    assert f"with {'xyz'[axis]} flipped" in report.sentence


def test_the_usual_mistakes_are_named(posts: Recording) -> None:
    recording = quick(posts)
    inverse = report_of(recording, TRUE.inverse())
    assert (inverse.verdict, "inverse" in inverse.sentence) == ("SUSPECT", True), inverse.sentence
    body = Pose(OPTICAL_FROM_BODY.T @ TRUE.matrix, OPTICAL_FROM_BODY.T @ TRUE.translation_m)
    lacking = report_of(recording, body)
    assert lacking.verdict == "SUSPECT"
    assert "lack the turn from x forward" in lacking.sentence
    assert f"give camera_from_radar {' '.join(map(str, TRUE.numbers))}" in lacking.sentence


def test_simulated_errors_are_caught(simulated: Recording) -> None:
    true = simulated.radars[0].camera_from_radar
    for matrix in (flip(1), turn(1, 1), turn(2, 1), true.matrix.T):
        report = report_of(simulated, Pose(true.matrix @ matrix, true.translation_m))
        assert report.verdict == "SUSPECT", report.sentence


def test_without_lidar_doppler_and_turns_of_the_vehicle_tell(posts: Recording) -> None:
    blind = quick(without_lidar(posts))
    for matrix in (flip(0), turn(0, 1), turn(2, 3)):
        assert report_of(blind, Pose(TRUE.matrix @ matrix, TRUE.translation_m)).verdict == "SUSPECT"


def test_left_and_right_are_unknown_where_nothing_tells(simulated: Recording) -> None:
    report = report_of(without_lidar(simulated), simulated.radars[0].camera_from_radar)
    assert report.verdict == "UNKNOWN"
    assert "with y flipped" in report.undecided
    assert "LiDAR" in report.sentence


def test_up_and_down_are_unknown_where_the_elevation_is_poor(simulated: Recording) -> None:
    true = simulated.radars[0].camera_from_radar
    for pose in (true, Pose(true.matrix @ flip(2), true.translation_m)):
        report = report_of(simulated, pose)
        assert (report.verdict, report.undecided) == ("OK", ("with z flipped",))
        assert "unknown whether the points belong with z flipped" in report.sentence


def test_up_and_down_that_only_the_road_tells_are_not_ok(posts: Recording) -> None:
    # As a 4D radar in town had it: with the cloud's z flipped, a sixth of its returns was below the road.
    _, placements = placed(posts, TRUE)
    parts = np.full((len(placements), 8, len(PARTS)), np.nan)
    parts[..., :3] = [0.5, 0.5, 0.3]
    parts[0, :, :3] = [0.55, 0.78, 0.62]
    parts[[placement.name for placement in placements].index("with z flipped"), :, :3] = [0.56, 0.94, 0.62]
    report = check_sensor("/radar", placements, parts, 1000, PARTS, ())
    assert (report.verdict, report.undecided) == ("UNKNOWN", ("with z flipped",))


def test_a_yaw_of_some_degrees_is_measured_by_doppler(posts: Recording) -> None:
    blind = without_lidar(posts)
    turn = np.deg2rad(4.0)
    right = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    report = report_of(blind, Pose(right @ TRUE.matrix, TRUE.translation_m))
    assert report.verdict == "SUSPECT"
    assert report.yaw_off_deg == pytest.approx(4.0, abs=0.5)
    assert "to the left" in report.sentence


def test_too_few_returns_are_unknown(posts: Recording) -> None:
    empty = tuple(dataclasses.replace(view, radar_m=(view.radar_m[0][:2],)) for view in posts.views)
    report = report_of(dataclasses.replace(posts, views=empty), TRUE)
    assert (report.verdict, report.given) == ("UNKNOWN", None)


@pytest.mark.parametrize("matrix", [np.eye(3), flip(1), turn(2, 1)])
def test_the_lidar_is_judged_by_the_road_and_the_radar(posts: Recording, matrix: np.ndarray) -> None:
    true = Pose.of(CAMERA_FROM_LIDAR)
    given = Pose(true.matrix @ matrix, true.translation_m)
    placements = alternatives(given, UP, "camera_from_lidar")
    parts = lidar_parts(dataclasses.replace(posts, camera_from_lidar=given), placements, (0,))
    report = check_sensor("/lidar/points", placements, parts, 1000, LIDAR_PARTS, ())
    assert report.verdict == ("OK" if np.array_equal(matrix, np.eye(3)) else "SUSPECT"), report.sentence
