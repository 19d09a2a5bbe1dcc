from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import run_main
from typer.testing import CliRunner

from radcam_depth_ros import cli, networks
from radcam_depth_ros.bags import BagReader, BagWriter, factory
from radcam_depth_ros.networks.weights_io import archive

ROOT = Path(__file__).parents[2]
VERBS = sorted(str(command.name or command.callback.__name__) for command in cli.app.registered_commands)


def run(*arguments: Any) -> Any:
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


def test_a_warning_is_its_sentence_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    assert run_main(monkeypatch, "--help") == 0
    assert warnings.formatwarning("an old key", UserWarning, "recipe.py", 1) == "radcam-depth: an old key\n"


def test_all_verbs_are_there() -> None:
    first = {"simulate", "replay", "evaluate", "train", "export", "networks", "inspect", "play", "view", "bench"}
    assert first | {"check-calibration"} <= set(VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_each_help_shows_an_example(verb: str) -> None:
    result = run(verb, "--help")
    assert result.exit_code == 0
    assert f"radcam-depth {verb}" in " ".join(result.output.replace("│", " ").split())


def example(verb: str) -> list[str]:
    """The arguments of the command that ends a verb's help; `make docs` runs those that take long."""
    command = next(command for command in cli.app.registered_commands if command.callback.__name__ == verb)
    return str(command.callback.__doc__).split("Example: radcam-depth ")[1].split()


def test_the_example_of_export_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*example("export"))
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "baff.pt").is_file()


@pytest.fixture(scope="module")
def heavy_imports_of_help() -> dict[str, list[str]]:
    """By verb, what its help is the first to import in a process that gives all helps, of what takes long."""
    script = f"""
import json, sys
from typer.testing import CliRunner
from radcam_depth_ros import cli
assert cli.__file__ == {str(ROOT / "radcam_depth_ros" / "cli" / "__init__.py")!r}, cli.__file__
found, known = {{}}, set()
for verb in {["", *VERBS]}:
    assert CliRunner().invoke(cli.app, [*verb.split(), "--help"]).exit_code == 0
    heavy = {{"torch", "cv2", "rosbags", "embreex", "numpy", "matplotlib"}} & sys.modules.keys()
    found[verb], known = sorted(heavy - known), heavy
print(json.dumps(found))
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("verb", ["", *VERBS])
def test_help_imports_nothing_heavy(verb: str, heavy_imports_of_help: dict[str, list[str]]) -> None:
    assert heavy_imports_of_help[verb] == []


def test_inspect(tmp_path: Path, write_drive: Callable[..., Path]) -> None:
    drive = write_drive(tmp_path / "drive.mcap")
    table = run("inspect", drive)
    assert table.exit_code == 0
    assert "/radar/points" in table.output
    found = json.loads(run("inspect", drive, "--json", "-").stdout)
    roles = {row["topic"]: row["role"] for row in found["topics"]}
    assert roles["/camera/image_raw"] == "camera"
    assert roles["/radar/points"] == "radar"
    assert roles["/ground_truth/depth"] == "ground truth (depth)"
    assert found["missing"] == ""
    lacking = json.loads(run("inspect", write_drive(tmp_path / "b", without=("/radar/points",)), "--json", "-").stdout)
    assert "radar" in lacking["missing"]


def test_inspect_writes_parameters_that_the_node_takes(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    target = tmp_path / "node.yaml"
    assert run("inspect", write_drive(tmp_path / "drive.mcap"), "--write-params", target).exit_code == 0
    parameters = yaml.safe_load(target.read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    assert parameters["radar_topics"] == ["/radar/points"]
    blind = write_drive(tmp_path / "blind.mcap", without=("/camera/image_raw",))
    capsys.readouterr()
    assert run_main(monkeypatch, "inspect", blind, "--write-params", tmp_path / "no.yaml") == 2
    told = capsys.readouterr()
    missing = json.loads(run("inspect", blind, "--json", "-").stdout)["missing"]
    assert missing
    assert " ".join(f"{told.out} {told.err}".split()).count(" ".join(missing.split())) == 1
    assert not (tmp_path / "no.yaml").exists()


def test_view_shows_what_a_network_gives_or_what_was_recorded(
    tmp_path: Path, write_drive: Callable[..., Path], small_weights: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, depth = write_drive(tmp_path / "drive.mcap", frames=3), tmp_path / "depth.mcap"
    assert run("replay", drive, depth, "--model", small_weights).exit_code == 0
    computed = run("view", drive, "--save", tmp_path / "a.png", "--model", small_weights, "--width", 480)
    assert computed.exit_code == 0, computed.output
    shown = run("view", drive, "--save", tmp_path / "b.png", "--depth", depth, "--width", 480)
    assert shown.exit_code == 0, shown.output
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert run_main(monkeypatch, "view", drive, "--save", tmp_path / "c.png", "--depth", drive) == 2
    both = ("--depth", depth, "--network", "baff")
    assert run_main(monkeypatch, "view", drive, "--save", tmp_path / "c.png", *both) == 2
    for place in ((), ("--rerun", "--save", tmp_path / "c.png")):
        assert run_main(monkeypatch, "view", drive, *place) == 2
    assert not (tmp_path / "c.png").exists()


def test_play_names_what_it_leaves_out(tmp_path: Path, write_drive: Callable[..., Path]) -> None:
    pytest.importorskip("rclpy")
    drive = write_drive(tmp_path / "drive.mcap", frames=2)
    result = run("play", drive, "--rate", "1000", "--delay", "0", "--clock")
    assert result.exit_code == 0, result.output
    is_left_out = importlib.util.find_spec("tf2_msgs") is None
    assert result.stderr.count("/tf_static cannot be published") == is_left_out


def test_play_ends_at_once_and_well_when_interrupted(tmp_path: Path, write_drive: Callable[..., Path]) -> None:
    pytest.importorskip("rclpy")
    drive = write_drive(tmp_path / "drive.mcap", without=("/tf_static",))
    command = [sys.executable, "-m", "radcam_depth_ros.cli", "play", str(drive), "--loop", "--delay", "0"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert process.stderr.readline().startswith("playing 4 topics")
    process.send_signal(signal.SIGINT)
    try:
        _, told = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, told
    assert "Traceback" not in told


def test_replay_and_export(tmp_path: Path, write_drive: Callable[..., Path], small_weights: Path) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=2)
    exported = tmp_path / "baff.pt"
    assert run("export", exported, "--model", small_weights).exit_code == 0
    outputs = ("--encoding", "16UC1", "--output-size", "network", "--points", "--points-stride", 4)
    result = run("replay", drive, tmp_path / "out.mcap", "--model", exported, *outputs, "--points-range", 0, 900)
    assert result.exit_code == 0, result.output
    with BagReader(tmp_path / "out.mcap") as reader:
        assert reader.count(["/depth/image_rect"]) == 2


def test_networks() -> None:
    entries = json.loads(run(*example("networks")).stdout)
    assert [entry["name"] for entry in entries] == list(networks.names())
    for entry in entries:
        assert entry["parameters"] > (1e6 if entry["weights"] else 0)
        assert entry["weights"] == archive.shipped(entry["name"]).exists()
        assert entry["about"]
        assert f"train --network {entry['name']} " in entry["train"]
    assert "baff" in run("networks").output


def test_json_without_a_file_goes_to_standard_output(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_main(monkeypatch, "networks", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)) == len(networks.names())
    bag = write_drive(tmp_path / "drive", frames=2)
    assert run_main(monkeypatch, "inspect", str(bag), "--json", "--write-params", str(tmp_path / "p.yaml")) == 0
    assert json.loads(capsys.readouterr().out)["topics"]


@pytest.mark.parametrize("verb", ["replay", "inspect", "evaluate", "play", "view"])
@pytest.mark.parametrize("kind", ["missing", "truncated", "empty"])
def test_a_bag_that_cannot_be_read_is_exit_code_2_and_one_sentence(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    small_weights: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verb: str,
    kind: str,
) -> None:
    bag = tmp_path / "drive.mcap"
    if kind != "missing":
        write_drive(bag, frames=2)
        bag.write_bytes(bag.read_bytes()[: 3000 if kind == "truncated" else 0])
    arguments: list[Any] = [verb, bag]
    if verb == "replay":
        arguments += [tmp_path / "out.mcap"]
    if verb == "view":
        arguments += ["--save", tmp_path / "out.mp4"]
    if verb not in ("inspect", "play"):
        arguments += ["--model", small_weights]
    assert run_main(monkeypatch, *arguments) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert told[-1].startswith("radcam-depth: ")
    assert "Traceback" not in "".join(told)
    assert not [path for path in tmp_path.iterdir() if path != bag]


def test_a_bag_that_lacks_a_topic_is_exit_code_2(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    small_weights: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=("/camera/camera_info",))
    assert run_main(monkeypatch, "replay", drive, tmp_path / "out.mcap", "--model", small_weights) == 2
    assert "camera_info" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]


def test_no_verb_writes_to_what_it_reads(tmp_path: Path) -> None:
    bag, weights = tmp_path / "bag.mcap", tmp_path / "baff.safetensors"
    with BagWriter(bag) as writer:
        writer.write("/text", factory("std_msgs/msg/String", data="kept"), 0)
    weights.write_bytes(b"weights")
    link = tmp_path / "link.mcap"
    link.symlink_to(bag)
    before = {path: path.read_bytes() for path in (bag, weights)}
    for arguments in (
        ["replay", str(bag), str(bag), "--overwrite"],
        ["replay", str(bag), str(link), "--overwrite"],
        ["evaluate", str(bag), "--json", str(bag)],
        ["evaluate", str(bag), "--csv", str(link)],
        ["evaluate", str(bag), "--report", str(bag), "--model", str(weights)],
        ["evaluate", str(bag), "--json", str(weights), "--model", str(weights)],
        ["view", str(bag), "--save", str(bag)],
        ["export", str(weights), "--model", str(weights)],
        ["inspect", str(bag), "--write-params", str(link)],
        ["check-calibration", str(bag), "--json", str(bag)],
        ["train", "--bags", str(bag), "--out", str(tmp_path), "--init", str(weights)],
    ):
        result = run(*arguments)
        assert "would be written to, but" in str(result.exception), arguments
    assert {path: path.read_bytes() for path in before} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["baff.safetensors", "bag.mcap", "link.mcap"]
