from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn
from typer.testing import CliRunner

from radcam_depth_ros import cli
from radcam_depth_ros.benchmarking import comparison, machine, measurement
from radcam_depth_ros.benchmarking.comparison import Against
from radcam_depth_ros.benchmarking.subject import Loaded, Size, Subject
from radcam_depth_ros.cli.terminal.bench_request import parse_against
from radcam_depth_ros.frame import RadcamDepthError
from radcam_depth_ros.networks.weights_io import torchscript

SIZE = Size(448, 800, 60)


@pytest.fixture
def parse() -> Callable[[str], Against]:
    return lambda spec: parse_against(spec, Subject("baff", precision="bfloat16"))


def test_the_papers_form_is_eager_float32_at_the_images_own_size(parse: Callable[[str], Against]) -> None:
    against = parse("paper")
    assert (against.subject.mode, against.subject.precision) == ("eager", "float32")
    assert (against.subject.network, against.subject.architecture) == ("baff_paper", {})
    assert against.size(SIZE) == Size(896, 1600, 60)
    assert parse("paper,size=448x800,points=10").size(SIZE) == Size(448, 800, 10)
    assert parse("paper,mode=frozen").subject.mode == "frozen"


def test_engine_keys_and_fields_of_the_architecture(parse: Callable[[str], Against]) -> None:
    against = parse("precision=float32,points=1000")
    assert (against.subject.precision, against.subject.mode) == ("float32", "frozen")
    assert against.size(SIZE) == Size(448, 800, 1000)
    against = parse("position_pool=(1, 1),position_attention=false")
    assert against.subject.architecture == {"position_pool": [1, 1], "position_attention": False}
    assert against.subject.precision == "bfloat16"
    assert against.size(SIZE) == SIZE


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("", "got ''"),
        ("papers", "got 'papers'"),
        ("precision=float32,mode", "takes `paper` or key=value"),
        ("a=[", "takes `paper` or key=value"),
        ("size=448", "HEIGHTxWIDTH in pixels, for example 448x800, got '448'"),
        ("points=many", "a whole number such as 60, got 'many'"),
        ("precision=int8", "precision must be one of"),
    ],
)
def test_what_cannot_be_held_against(parse: Callable[[str], Against], spec: str, message: str) -> None:
    with pytest.raises(RadcamDepthError, match=message):
        parse(spec)


@pytest.fixture(scope="module")
def _made_ready_once() -> Iterator[None]:
    """Networks are loaded, and they and their stages frozen, once for all runs: that is most of the time of a run."""
    load, freeze = Subject.load, torchscript.freeze
    loaded: dict[str, Loaded] = {}
    frozen: dict[tuple[nn.Module, torch.dtype], torch.jit.ScriptModule] = {}

    def load_once(subject: Subject) -> Loaded:
        key = f"{subject.network} {subject.model_file} {subject.architecture}"
        if key not in loaded:
            loaded[key] = load(subject)
        return loaded[key]

    def freeze_once(network: nn.Module, dtype: torch.dtype = torch.float32) -> torch.jit.ScriptModule:
        if (network, dtype) not in frozen:
            frozen[network, dtype] = freeze(network, dtype)
        return frozen[network, dtype]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Subject, "load", load_once)
        patch.setattr(torchscript, "freeze", freeze_once)
        yield


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, small_weights: Path, _made_ready_once: None) -> Callable[..., Any]:
    """Runs the verb with small probes and without other processes."""
    monkeypatch.setattr(machine, "CONVOLUTIONS", ((8, 16, 16),))
    monkeypatch.setattr(machine, "PRODUCT", 32)
    monkeypatch.setattr(comparison, "TURN_S", 0.0)
    for module in (measurement, comparison):
        monkeypatch.setattr(module, "process_peak_mb", lambda subject, size: 100.0)
    fixed = ["bench", "--model", str(small_weights), "--repeats", "2"]
    return lambda *arguments: CliRunner().invoke(cli.app, [*fixed, *(str(argument) for argument in arguments)])


def test_a_row_for_each_size_and_number_of_points(run: Callable[..., Any], tmp_path: Path) -> None:
    target = tmp_path / "bench.json"
    result = run("--size", "32x64", "--size", "64x64", "--points", "0,3", "--against", "mode=eager", "--json", target)
    assert result.exit_code == 0, result.output
    values = json.loads(target.read_text(encoding="utf-8"))
    sizes = [(row["height"], row["width"], row["points"]) for row in values["sizes"]]
    assert sizes == [(32, 64, 0), (32, 64, 3), (64, 64, 0), (64, 64, 3)]
    assert [row["other"]["points"] for row in values["against"]["sizes"]] == [0, 3, 0, 3]
    assert values["against"]["sizes"][0]["depth_difference"] < 1e-3
    for word in ("sections at 64 x 64, 3 points", "whole network", "against mode=eager", "ratios pair by pair"):
        assert word in result.output


def test_json_to_stdout_is_json_alone(run: Callable[..., Any]) -> None:
    assert json.loads(run("--size", "32x32", "--json", "-").stdout)["against"] is None


def test_a_bags_frames_are_compared(run: Callable[..., Any], write_drive: Callable[..., Path], tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=3)
    arguments = ("--size", "32x32", "--precision", "float32", "--bag", drive, "--limit", "2")
    result = run(*arguments, "--against", "precision=auto", "--json", "-")
    assert json.loads(result.stdout)["against"]["drive"]["frames"] == 2
    assert isinstance(run(*arguments).exception, RadcamDepthError)


@pytest.mark.parametrize("arguments", [("--size", "448"), ("--points", "ten"), ("--precision", "float8")])
def test_options_that_cannot_be(run: Callable[..., Any], arguments: tuple[str, str]) -> None:
    assert isinstance(run(*arguments).exception, RadcamDepthError)
