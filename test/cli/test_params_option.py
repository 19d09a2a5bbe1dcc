"""`--params`: the node's parameter file in the verbs that read bags."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from small_drive import CAMERA_FROM_RADAR
from typer.testing import CliRunner

from radcam_depth_ros import cli
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.cli.terminal.node_parameters import NodeParameters, node_parameters
from radcam_depth_ros.drive import DriveSettings, TopicChoice
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.parameters import RENAMED

ROOT = Path(__file__).parents[2]
NODE_YAML = ROOT / "config" / "node_all.yaml"
POSE = [float(value) for value in (*CAMERA_FROM_RADAR.translation, *CAMERA_FROM_RADAR.quaternion)]
VERBS = {
    "replay": ("out.mcap", "--model", "no_such_file.pt"),
    "evaluate": ("--model", "no_such_file.pt"),
    "view": ("--save", "out.png", "--model", "no_such_file.pt"),
    "check-calibration": (),
    "train": ("--out", "run"),
}


def run(*arguments: Any) -> Any:
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Writes a parameter file: `write(radar_sweeps=3)`."""

    def write(name: str = "vehicle.yaml", section: str = "/**", **values: Any) -> Path:
        (tmp_path / name).write_text(yaml.safe_dump({section: {"ros__parameters": values}}), encoding="utf-8")
        return tmp_path / name

    return write


@pytest.fixture
def read(write: Callable[..., Path]) -> Callable[..., NodeParameters]:
    """What a file says, and options: `read({"image_topic": "/a"}, radar_sweeps=3)`."""
    return lambda given=None, **values: node_parameters(write(**values), given or {})


def test_an_old_name_of_a_parameter_is_taken_and_named(
    read: Callable[..., NodeParameters], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(RENAMED, "sweeps", "radar_sweeps")
    assert read(sweeps=3).config.frame_builder.pairing.radar_sweeps == 3
    assert "sweeps is now called radar_sweeps" in capsys.readouterr().err


def test_without_a_file_and_options_a_bag_is_read_as_ever() -> None:
    assert node_parameters(None, {"image_topic": None}).drive_settings() == DriveSettings()


@pytest.mark.parametrize("section", ["/**", "/front/radcam_depth"])
def test_topics_are_full_names_as_in_the_node(write: Callable[..., Path], section: str) -> None:
    values = {"image_topic": "left/image", "radar_topics": ["/r", "s"], "odometry_topic": "~/odometry"}
    space = section.removesuffix("/radcam_depth").removesuffix("/**")
    topics = node_parameters(write(section=section, **values), {}).topics
    assert (topics.image, topics.radars) == (f"{space}/left/image", ("/r", f"{space}/s"))
    assert (topics.camera_info, topics.odometry) == (None, f"{space}/radcam_depth/odometry")


def test_topics_of_the_nodes_default_name_are_taken_where_they_are_else_found(read: Callable[..., Any]) -> None:
    assert node_parameters(NODE_YAML, {}).topics == read(threads=1).topics
    topics = read(image_transport="compressed").topics
    assert (topics.image, topics.radars, topics.is_compressed) == (None, None, True)
    assert topics.preferred == ("/image/compressed", "/radar/points")
    # As in the node: without odometry_topic, /tf moves returns.
    assert topics.odometry == ""


@pytest.mark.parametrize(
    ("transport", "name", "topic"),
    [
        ("compressed", "/front/image_raw", "/front/image_raw/compressed"),
        ("compressed", "/front/image_raw/compressed", "/front/image_raw/compressed"),
        ("compressed_topic", "/front/jpeg", "/front/jpeg"),
        ("raw", "/front/image_raw", "/front/image_raw"),
    ],
)
def test_the_image_topic_is_that_of_the_transport(
    read: Callable[..., Any], transport: str, name: str, topic: str
) -> None:
    topics = read(image_transport=transport, image_topic=name).topics
    assert (topics.image, topics.is_compressed) == (topic, transport != "raw")


def test_options_win_over_the_file(read: Callable[..., Any]) -> None:
    file = {
        "image_topic": "/a",
        "image_transport": "compressed",
        "camera_info_topic": "/info",
        "radar_topics": ["/x", "/y"],
        "radar_sweeps": 3,
        "model_file": "mine.pt",
        "depth_encoding": "16UC1",
    }
    node = read(**file)
    assert node.config.frame_builder.pairing.radar_sweeps == 3
    assert node.config.estimator.model_file == "mine.pt"
    given = {"image_topic": "/b", "radar_topics": ["/r"], "radar_sweeps": 1, "network": "structured", "device": None}
    node = read(given, **file)
    assert node.topics == TopicChoice(image="/b", radars=("/r",), odometry="")
    assert node.config.frame_builder.pairing.radar_sweeps == 1
    assert (node.config.estimator.network, node.config.estimator.model_file) == ("structured", "")
    assert node.config.output.depth_encoding == "16UC1"


def test_what_makes_frames_is_the_nodes_config_itself(read: Callable[..., Any]) -> None:
    node = read(radar_topics=["/a", "/b"], radar_frame=["left", "right"], footprint_frame="road", radar_sweeps=3)
    assert node.drive_settings().frame_builder == node.config.frame_builder
    assert type(node.drive_settings().frame_builder) is FrameBuilderConfig


def test_extrinsics_by_option_are_of_as_many_radars_as_there_are_numbers() -> None:
    node = node_parameters(None, {"camera_from_radar": POSE * 2})
    assert (len(node.config.frame_builder.radars), node.topics.radars) == (2, None)
    with pytest.raises(RadcamDepthError, match="camera_from_radar"):
        node_parameters(None, {"camera_from_radar": POSE[:3]})


@pytest.mark.parametrize(
    ("values", "token"),
    [
        ({"radar_sweep": 3}, "did you mean radar_sweeps?"),
        ({"max_wait_s": "soon"}, "max_wait_s must be a number"),
        ({"radar_frame": ["a", "b"]}, "radar_frame"),
    ],
)
@pytest.mark.parametrize("verb", VERBS)
def test_a_file_that_the_node_would_refuse_is_exit_code_2_and_one_sentence(
    tmp_path: Path,
    write: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verb: str,
    values: dict[str, Any],
    token: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [verb, "drive.mcap", *VERBS[verb], "--params", str(write(**values))]
    monkeypatch.setattr(sys, "argv", ["radcam-depth", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    (told,) = capsys.readouterr().err.strip().splitlines()
    assert "vehicle.yaml: " in told
    assert token in told
    assert [path.name for path in tmp_path.iterdir()] == ["vehicle.yaml"]


@pytest.mark.parametrize(
    ("values", "tokens"),
    [
        ({"image_topic": "/camera/image_row"}, ("/camera/image_row", "/camera/image_raw", "image_topic")),
        ({"camera_info_topic": "/info"}, ("/info", "/camera/camera_info", "camera_info_topic")),
        ({"radar_topics": ["/radar/point"]}, ("/radar/point ", "/radar/points", "radar_topics")),
        ({"odometry_topic": "/odom"}, ("/odom", "odometry_topic")),
        ({"image_topic": "/camera/image_raw", "image_transport": "compressed"}, ("/camera/image_raw/compressed",)),
    ],
)
def test_a_topic_that_the_bag_lacks_is_refused_by_its_key(
    tmp_path: Path, write_drive: Callable[..., Path], read: Callable[..., Any], values: Any, tokens: tuple[str, ...]
) -> None:
    settings = read(**values).drive_settings()
    with (
        BagReader(write_drive(tmp_path / "drive.mcap", frames=1)) as reader,
        pytest.raises(RadcamDepthError) as caught,
    ):
        settings.find_topics(reader)
    assert all(token in str(caught.value) for token in tokens)


def test_the_nodes_own_file_serves_replay_and_names_what_has_no_effect(
    tmp_path: Path, write_drive: Callable[..., Path], small_weights: Path
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=2)
    for name, options in (("a.mcap", ()), ("b.mcap", ("--params", NODE_YAML))):
        result = run("replay", drive, tmp_path / name, "--model", small_weights, *options, "--precision", "float32")
        assert result.exit_code == 0, result.output
    assert f"{NODE_YAML}: without effect here: autostart" in result.stderr
    depths = []
    for name in ("a.mcap", "b.mcap"):
        with BagReader(tmp_path / name) as reader:
            depths.append([bytes(item.message.data) for item in reader.messages(["/depth/image_rect"])])
    assert depths[0] == depths[1]


def test_what_inspect_writes_is_read(tmp_path: Path, write_drive: Callable[..., Path], small_weights: Path) -> None:
    drive, file = write_drive(tmp_path / "drive.mcap", frames=2), tmp_path / "vehicle.yaml"
    assert run("inspect", drive, "--write-params", file).exit_code == 0
    shown = run("view", drive, "--save", tmp_path / "a.png", "--params", file, "--model", small_weights, "--frames", 1)
    assert shown.exit_code == 0, shown.output
    old = run("inspect", drive, "--params", tmp_path / "old.yaml")
    assert old.exit_code == 0
    assert "--write-params" in old.stderr
    assert (tmp_path / "old.yaml").read_bytes() == file.read_bytes()
    assert "--write-params" not in run("inspect", drive, "--write-params", file).stderr


def test_how_depth_is_written_changes_nothing_that_is_measured(
    tmp_path: Path, write_drive: Callable[..., Path], write: Callable[..., Path], small_weights: Path
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=2)
    common = ("evaluate", drive, "--no-baselines", "--json", "-", "--model", small_weights, "--precision", "float32")
    plain = json.loads(run(*common).stdout)
    file = write(output_size="network", depth_encoding="16UC1", points_stride=4, preview_far_m=50.0)
    told = run(*common, "--params", file)
    assert told.exit_code == 0, told.output
    assert "depth_encoding, preview_far_m, points_stride, output_size" in told.stderr
    found = json.loads(told.stdout)
    assert found["dense"] == plain["dense"]
    # Where the radars are does change it.
    moved = write(camera_from_radar=[0.0, 3.0, 0.0, *POSE[3:]])
    assert json.loads(run(*common, "--params", moved).stdout)["dense"] != plain["dense"]


def test_a_training_run_keeps_how_its_bags_are_read(
    tmp_path: Path, write_drive: Callable[..., Path], write: Callable[..., Path]
) -> None:
    from radcam_depth_ros.training.plan import RunPlan

    first = write_drive(tmp_path / "drives" / "a.mcap", frames=2)
    shutil.copy(first, tmp_path / "drives" / "b.mcap")
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("{iterations: 1, precision: float32, phases: [{share: 1.0, crops: [[64, 64]], batch: 2}]}")
    file = write(radar_topics=["/radar/points"], max_time_offset_s=0.05, device="cuda", depth_encoding="16UC1")
    out = tmp_path / "run"
    words = ("--bags", tmp_path / "drives", "--out", out, "--config", recipe, "--processes", 1)
    result = run("train", *words, "--params", file)
    assert result.exit_code == 0, result.output
    assert "without effect here: depth_encoding, device" in result.stderr
    plan = RunPlan.read(out)
    assert plan.topics.radars == ("/radar/points",)
    assert plan.drive.frame_builder.pairing.max_time_offset_s == 0.05
    # Rehearsed drives are of another vehicle.
    assert plan.rehearsed_drive.topics == TopicChoice()
    assert plan.rehearsed_drive.frame_builder == FrameBuilderConfig()
    resumed = run("train", "--out", out, "--resume", "--params", file)
    assert "--params" in str(resumed.exception)
