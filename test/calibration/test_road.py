from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from road_drive import CAMERA, HEIGHT_M, PITCH_DEG, ROLL_DEG, PlaneDrive, render, scan, write_plane_drive
from typer.testing import CliRunner

from radcam_depth_ros import cli
from radcam_depth_ros.calibration import OK, SUSPECT, UNKNOWN, RoadReport, check_road
from radcam_depth_ros.calibration.road import likely_height_m
from radcam_depth_ros.calibration.road_plane import PlaneEstimate, fit_plane, pool
from radcam_depth_ros.calibration.road_texture import TextureError, TexturePair

FLOORS = (0.01, 0.1, 0.1)


def check(path: Path, **drive: Any) -> RoadReport:
    return check_road(write_plane_drive(path / "drive.mcap", PlaneDrive(**drive)), frames=6)


def assert_is_right(report: RoadReport) -> None:
    height, pitch, roll = report.values
    assert height.value == pytest.approx(HEIGHT_M, rel=0.03)
    assert pitch.value == pytest.approx(PITCH_DEG, abs=0.25)
    assert roll.value == pytest.approx(ROLL_DEG, abs=0.4)
    for value, truth in zip(report.values, (HEIGHT_M, PITCH_DEG, ROLL_DEG), strict=True):
        assert value.value is not None
        assert value.deviation is not None
        assert abs(value.value - truth) < 3 * value.deviation


@pytest.mark.parametrize("height_m", [1.35, 1.65])
def test_two_images_of_a_textured_plane_tell_it(height_m: float) -> None:
    found = TexturePair(render(0.0), render(1.4), CAMERA, 1.4).fit(height_m)
    assert found.height_m == pytest.approx(HEIGHT_M, rel=0.02)
    assert found.pitch_deg == pytest.approx(PITCH_DEG, abs=0.2)
    assert found.roll_deg == pytest.approx(ROLL_DEG, abs=0.3)


def test_the_height_is_found_among_many() -> None:
    heights_m = np.geomspace(0.6, 4.0, 20)
    scores = TexturePair(render(0.0), render(1.4), CAMERA, 1.4).scores(heights_m)
    assert heights_m[scores.argmax()] == pytest.approx(HEIGHT_M, rel=0.1)


def test_images_without_texture_tell_nothing() -> None:
    plain = np.full_like(render(0.0), 120)
    with pytest.raises(TextureError, match="texture"):
        TexturePair(plain, plain, CAMERA, 1.4)


def test_scores_without_a_peak_give_no_height() -> None:
    assert likely_height_m(np.full((4, 34), 0.3)) is None


def test_lidar_points_with_clutter_tell_the_road() -> None:
    found = fit_plane(np.float32(scan(np.random.default_rng(0))))
    assert found is not None
    assert found.height_m == pytest.approx(HEIGHT_M, rel=0.01)
    assert found.pitch_deg == pytest.approx(PITCH_DEG, abs=0.1)
    assert found.roll_deg == pytest.approx(ROLL_DEG, abs=0.1)


def test_lidar_points_without_the_road_tell_nothing() -> None:
    assert fit_plane(np.zeros((0, 3), np.float32)) is None
    assert fit_plane(np.float32(scan(np.random.default_rng(0))[:20])) is None


def test_pooling_leaves_out_strays_and_does_not_count_neighbours_twice() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 0.02, 40)
    alike = np.repeat(noise[:8], 5)
    estimates = [[PlaneEstimate(1.5 + off, 2.0, 0.0, (0.1, 0.1, 0.1)) for off in row] for row in (noise, alike)]
    estimates[0][::8] = [PlaneEstimate(3.0, 2.0, 0.0, (0.1, 0.1, 0.1))] * 5
    single, repeated = (pool(row, (0.0, 0.0, 0.0)) for row in estimates)
    assert single is not None
    assert repeated is not None
    assert single.numbers[0] == pytest.approx(1.5, abs=0.02)
    assert repeated.deviations[0] > 1.5 * single.deviations[0]
    assert pool(estimates[0][:2], FLOORS) is None


@pytest.mark.parametrize(
    ("drive", "source"),
    [
        ({"lidar": True, "images": 4}, "lidar"),
        ({}, "texture+odometry"),
        ({"odometry": False}, "texture+doppler"),
        ({"lidar": True, "scan_has_road": False}, "texture+odometry"),
    ],
)
def test_every_source_tells_the_road(tmp_path: Path, drive: dict[str, Any], source: str) -> None:
    report = check(tmp_path, **drive)
    assert (report.source, report.verdict) == (source, OK), report
    assert_is_right(report)


def test_a_wrong_transform_is_suspect(tmp_path: Path) -> None:
    report = check(tmp_path, lidar=True, images=4, told_height_m=1.9)
    assert report.verdict == report.values[0].verdict == SUSPECT
    assert "+0.40 m" in report.values[0].sentence


@pytest.mark.parametrize(
    ("drive", "word"),
    [
        ({"speed_mps": 0.0}, "hardly moves"),
        ({"odometry": False, "doppler": False}, "odometry"),
        ({"texture": 0.0}, "texture"),
    ],
)
def test_what_cannot_be_known_is_said(tmp_path: Path, drive: dict[str, Any], word: str) -> None:
    report = check(tmp_path, **drive)
    assert report.verdict == UNKNOWN
    assert word in report.sentence
    assert all(value.value is None for value in report.values)


def test_the_verb_writes_json_and_parameters(tmp_path: Path) -> None:
    bag = write_plane_drive(tmp_path / "drive.mcap", PlaneDrive(lidar=True, images=4, told_height_m=1.9))
    params, figures = tmp_path / "road.yaml", tmp_path / "road.json"
    arguments = ["check-calibration", str(bag), "--road", "--write-params", str(params)]
    done = CliRunner().invoke(cli.app, arguments)
    assert done.exit_code == 1, done.output
    assert "camera_height_m: off by +0.40 m" in done.output
    written = yaml.safe_load(params.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    assert written["camera_height_m"] == pytest.approx(HEIGHT_M, rel=0.01)
    assert set(written) == {"camera_height_m", "camera_pitch_deg", "camera_roll_deg"}
    done = CliRunner().invoke(
        cli.app, ["check-calibration", str(bag), "--road", "--params", str(params), "--json", str(figures)]
    )
    assert done.exit_code == 0, done.output
    report = json.loads(figures.read_text(encoding="utf-8"))
    assert report["verdict"] == OK
    assert report["values"][0]["parameter"] == "camera_height_m"


def test_parameters_of_an_unknown_road_are_not_written(tmp_path: Path) -> None:
    bag = write_plane_drive(tmp_path / "drive.mcap", PlaneDrive(speed_mps=0.0, images=3))
    done = CliRunner().invoke(
        cli.app, ["check-calibration", str(bag), "--road", "--write-params", str(tmp_path / "road.yaml")]
    )
    assert done.exit_code != 0
    assert "hardly moves" in str(done.exception)
    assert not (tmp_path / "road.yaml").exists()
