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
