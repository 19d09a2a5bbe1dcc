from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import pytest
from calibration_drive import CAMERA_FROM_RADAR, PostsDrive, write_posts_drive
from typer.testing import CliRunner

from radcam_depth_ros import cli
from radcam_depth_ros.calibration.placements import Pose

FEW = ("--frames", "2")


@pytest.fixture(scope="module")
def short_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of it."""
    return write_posts_drive(tmp_path_factory.mktemp("short") / "drive.mcap", PostsDrive(seconds=1.0))


def run(*arguments: Any) -> Any:
    return CliRunner().invoke(cli.app, ["check-calibration", *(str(argument) for argument in arguments)])


def test_a_verdict_a_table_and_pictures(short_bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "overlays"
    done = run(short_bag, *FEW, "--out", out)
    assert done.exit_code == 0, done.output
    assert "OK: /radar/points, place" in done.output
    assert "as given" in done.output
    assert "UNKNOWN: /radar/points, time" in done.output
    assert sorted(path.name for path in out.iterdir()) == ["000.png", "001.png"]
    picture = cv2.imread(str(out / "000.png"))
    assert picture is not None
    assert picture.shape[1] >= 640
    assert picture.std() > 20


def test_a_suspect_is_named_in_json_and_by_the_exit_code(short_bag: Path, tmp_path: Path) -> None:
    wrong = " ".join(map(str, Pose.of(CAMERA_FROM_RADAR.inverse()).numbers))
    target = tmp_path / "report.json"
    done = run(short_bag, *FEW, "--camera-from-radar", wrong, "--json", target)
    assert done.exit_code == 1, done.output
    report = json.loads(target.read_text(encoding="utf-8"))
    assert report["verdict"] == report["sensors"][0]["verdict"] == "SUSPECT"
    assert "given as its inverse" in report["sensors"][0]["sentence"]
    assert report["sensors"][0]["given"]["score"] < report["sensors"][0]["alternatives"][0]["score"]
    assert report["pictures"] == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--camera-from-radar", "1 2 x"), "x y z qx qy qz qw"),
        (("--camera-from-radar", "1 2 3"), "camera_from_radar needs"),
        (("--radar", "/rader/points"), "/radar/points"),
    ],
)
def test_bad_requests_are_one_sentence(
    short_bag: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.setattr(sys, "argv", ["radcam-depth", "check-calibration", str(short_bag), *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
