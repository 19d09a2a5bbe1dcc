from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.cli.simulate import simulate
from radcam_depth_ros.frame import RadcamDepthError

TINY = """
world: {view_m: 100, street: rural}
camera: {width: 64, height: 32, edge_samples: 0}
lidar: {enabled: false}
key_frames: true
"""


@pytest.fixture
def app() -> typer.Typer:
    application = typer.Typer()
    application.command()(simulate)
    return application


def test_the_verb_writes_a_bag_and_shows_progress(app: typer.Typer, tmp_path: Path) -> None:
    config, out = tmp_path / "tiny.yaml", tmp_path / "drive"
    config.write_text(TINY, encoding="utf-8")
    result = CliRunner().invoke(app, [str(out), "--seed", "4", "--frames", "2", "--config", str(config)])
    assert result.exit_code == 0, result.output
    assert "2/2" in result.stderr
    with BagReader(out) as reader:
        assert {topic.name: topic.count for topic in reader.topics}["/camera/image_raw/compressed"] == 2
    again = CliRunner().invoke(app, [str(out), "--frames", "1", "--config", str(config)])
    assert isinstance(again.exception, RadcamDepthError)
    assert str(out) in str(again.exception)
    replaced = CliRunner().invoke(app, [str(out), "--frames", "1", "--config", str(config), "--overwrite"])
    assert replaced.exit_code == 0, replaced.output


def test_help_shows_an_example(app: typer.Typer) -> None:
    assert "radcam-depth simulate out/drive --seed 7 --frames 20" in CliRunner().invoke(app, ["--help"]).output


def test_an_unknown_setting_is_named(app: typer.Typer, tmp_path: Path) -> None:
    config = tmp_path / "wrong.yaml"
    config.write_text("camera: {widht: 64}", encoding="utf-8")
    result = CliRunner().invoke(app, [str(tmp_path / "drive"), "--config", str(config)])
    assert isinstance(result.exception, RadcamDepthError)
    assert "width" in str(result.exception)


def test_several_drives_are_written_and_those_that_are_there_are_kept(app: typer.Typer, tmp_path: Path) -> None:
    config, out = tmp_path / "tiny.yaml", tmp_path / "drives"
    config.write_text(TINY, encoding="utf-8")
    options = [str(out), "--frames", "1", "--config", str(config), "--jobs", "1"]
    result = CliRunner().invoke(app, [*options, "--seed", "4", "--drives", "1"])
    assert result.exit_code == 0, result.output
    written = (out / "4" / "metadata.yaml").stat().st_mtime_ns
    result = CliRunner().invoke(app, [*options, "--seed", "4", "--drives", "2"])
    assert result.exit_code == 0, result.output
    assert "2/2" in result.stderr
    assert sorted(path.name for path in out.iterdir()) == ["4", "5"]
    assert (out / "4" / "metadata.yaml").stat().st_mtime_ns == written
    CliRunner().invoke(app, [str(tmp_path / "alone"), "--seed", "5", "--frames", "1", "--config", str(config)])
    with BagReader(out / "5") as several, BagReader(tmp_path / "alone") as alone:
        assert [(topic.name, topic.count) for topic in several.topics] == [
            (topic.name, topic.count) for topic in alone.topics
        ]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["drives", "--jobs", "2"], "say how many by --drives"),
        (["drives.mcap", "--drives", "2"], "expected a folder for the bags of 2 drives"),
        (["drives", "--drives", "0"], "expected at least 1 drive and 1 process, got 0 and"),
        (["drives", "--drives", "2", "--jobs", "0"], "expected at least 1 drive and 1 process, got 2 and 0"),
    ],
)
def test_several_drives_that_cannot_be_are_refused(
    app: typer.Typer, tmp_path: Path, options: list[str], told: str
) -> None:
    result = CliRunner().invoke(app, [str(tmp_path / options[0]), *options[1:]])
    assert isinstance(result.exception, RadcamDepthError)
    assert told in str(result.exception)
    assert not (tmp_path / options[0]).exists()
