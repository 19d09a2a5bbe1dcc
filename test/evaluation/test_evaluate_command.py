from __future__ import annotations

import csv
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import typer
from typer.testing import CliRunner

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.cli.evaluate import evaluate
from radcam_depth_ros.cli.terminal.options import load_estimator
from radcam_depth_ros.estimator import EstimatorConfig
from radcam_depth_ros.evaluation.measures.errors import EvaluationError
from radcam_depth_ros.evaluation.measures.metrics import MEASURES
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import (
    StampedTransform,
    encode_camera_info,
    encode_depth,
    encode_image,
    encode_points,
    encode_transforms,
)
from radcam_depth_ros.networks import registry
from radcam_depth_ros.networks.weights_io import archive

CAMERA = CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5)
FRAMES = 3


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    torch.manual_seed(0)
    network = registry.create("baff")
    path = tmp_path_factory.mktemp("model") / "untrained.safetensors"
    archive.save(network, archive.Card.of(network, "baff", "nothing"), path)
    return path


@pytest.fixture(scope="module")
def estimator(model):
    return load_estimator(EstimatorConfig(model_file=str(model), precision="float32"))


@pytest.fixture
def loaded(monkeypatch, estimator):
    """Loading takes longer than measuring a few frames: it is done once."""
    # By sys.modules: the package has a function of the module's name.
    monkeypatch.setattr(sys.modules[evaluate.__module__], "load_estimator", lambda *_: estimator)


@pytest.fixture
def app():
    application = typer.Typer()
    application.command()(evaluate)
    return application


def write_drive(path, with_depth=True, depth_delay_ns=0, scenario=None):
    generator = np.random.default_rng(0)
    points = {name: np.array(values, np.float32) for name, values in (("x", [0.1]), ("y", [0.0]), ("z", [20.0]))}
    depth = np.full((64, 96), 25.0, np.float32)
    depth[:8] = np.inf
    link = StampedTransform("camera", "radar", 0, RigidTransform.identity())
    with BagWriter(path) as bag:
        bag.write("/tf_static", encode_transforms(factory, [link]), 0)
        if scenario:
            bag.write("/scenario", factory("std_msgs/msg/String", data=json.dumps(scenario)), 0)
        for index in range(FRAMES):
            stamp = 10**9 + index * 10**8
            image = generator.integers(0, 255, (64, 96, 3), np.uint8)
            bag.write("/camera/camera_info", encode_camera_info(factory, CAMERA, stamp, "camera"), stamp)
            bag.write("/camera/image_raw", encode_image(factory, image, stamp, "camera"), stamp)
            bag.write("/radar/points", encode_points(factory, points, stamp, "radar"), stamp)
            if with_depth:
                truth = encode_depth(factory, depth, stamp + depth_delay_ns, "camera")
                bag.write("/ground_truth/depth", truth, stamp + depth_delay_ns)
    return path


@pytest.mark.usefixtures("number_format")
def test_json_alone_goes_to_standard_output(tmp_path, model, app):
    bag = write_drive(tmp_path / "drive")
    done = CliRunner().invoke(app, [str(bag), "--model", str(model), "--json", "-"])
    assert done.exit_code == 0, done.output
    plain = json.loads(done.stdout)
    assert (plain["network"], plain["frames"], plain["bag"]) == ("baff", FRAMES, str(bag))
    assert plain["ground_truth"] == "exact"
    assert set(MEASURES) <= set(plain["dense"]["80"])
    assert plain["baselines"]["ground_nearest"]["80"]["mae"] == pytest.approx(5.0)
    assert plain["semi_dense"]["coverage"] >= 0
    assert plain["edges"]["80"]["frames"] == FRAMES
    assert plain["things"] == {}
    assert "evaluating" in done.stderr


def test_a_table_and_files_are_written(tmp_path, loaded, app):
    bag = write_drive(tmp_path / "drive.mcap")
    page, measures = tmp_path / "out" / "page.html", tmp_path / "out" / "measures.json"
    options = ["--report", str(page), "--json", str(measures), "--limit", "2", "--camera-height", "1.7"]
    done = CliRunner().invoke(app, [str(bag), *options])
    assert done.exit_code == 0, done.output
    assert "geometry alone" in done.stdout
    assert "near edges" in done.stdout
    assert "1.70 m (as given)" in done.stdout
    plain = json.loads(measures.read_text(encoding="utf-8"))
    assert plain["frames"] == 2
    assert plain["baselines"]["ground_nearest"]["camera_height_source"] == "given"
    assert "error of the dense depth" in page.read_text(encoding="utf-8")


def test_several_bags_and_folders_are_one_evaluation(tmp_path, loaded, app):
    for seed, weather in ((1, "rain"), (2, "dry"), (3, "rain")):
        write_drive(tmp_path / "drives" / str(seed), scenario={"weather": weather, "time_of_day": "night"})
    other = write_drive(tmp_path / "other.mcap")
    page, lines = tmp_path / "page.html", tmp_path / "frames.csv"
    options = ["--json", "-", "--csv", str(lines), "--report", str(page), "--limit", "2"]
    done = CliRunner().invoke(app, [str(tmp_path / "drives"), str(other), *options])
    assert done.exit_code == 0, done.output
    plain = json.loads(done.stdout)
    assert plain["frames"] == 8
    assert [Path(bag).name for bag in plain["bags"]] == ["1", "2", "3", "other.mcap"]
    assert {name: group["frames"] for name, group in plain["by_bag"].items()} == {"1": 2, "2": 2, "3": 2, "other": 2}
    assert {name: group["frames"] for name, group in plain["by_weather"].items()} == {"rain": 4, "dry": 2}
    assert set(plain["baselines"]) == {"ground_nearest", "camera_only", "radar_interpolation"}
    assert set(MEASURES) <= set(plain["baselines"]["camera_only"]["50"])
    assert len(plain["sparsification"]["mae"]["by_confidence"]) == 20
    with lines.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["bag"] for row in rows] == [name for name in ("1", "2", "3", "other") for _ in range(2)]
    assert [row["time_of_day"] for row in rows] == ["night"] * 6 + [""] * 2
    mean = np.mean([float(row["mae_80"]) for row in rows])
    assert mean == pytest.approx(plain["dense"]["80"]["mae"], rel=1e-4)
    shown = page.read_text(encoding="utf-8")
    for part in ("By weather", "By bag", "The worst frames", "Sparsification, MAE", "Error over distance", "4 bags"):
        assert part in shown


def test_the_network_may_be_measured_alone(tmp_path, loaded, app):
    bag = write_drive(tmp_path / "drive")
    done = CliRunner().invoke(app, [str(bag), "--json", "-", "--no-baselines"])
    assert json.loads(done.stdout)["baselines"] == {}
    chosen = ["--json", "-", "--baselines", "radar_interpolation, ground_nearest"]
    done = CliRunner().invoke(app, [str(bag), *chosen])
    assert list(json.loads(done.stdout)["baselines"]) == ["radar_interpolation", "ground_nearest"]
    done = CliRunner().invoke(app, [str(bag), "--baselines", "guess"])
    assert isinstance(done.exception, EvaluationError)
    assert "got 'guess'" in str(done.exception)


def test_bags_of_one_name_are_told_apart(tmp_path, loaded, app):
    for place in ("a", "b"):
        write_drive(tmp_path / place / "drive")
    done = CliRunner().invoke(app, [str(tmp_path), "--json", "-", "--no-baselines"])
    assert set(json.loads(done.stdout)["by_bag"]) == {str(tmp_path / place / "drive") for place in ("a", "b")}


def test_a_bag_that_says_nothing_is_named(tmp_path, loaded, app):
    write_drive(tmp_path / "good")
    write_drive(tmp_path / "late", depth_delay_ns=10_000_000)
    done = CliRunner().invoke(app, [str(tmp_path), "--no-baselines"])
    assert done.exit_code == 0, done.output
    assert "bags without ground truth within 80 m: late" in done.stdout


def test_a_place_without_bags_is_refused(tmp_path, app):
    done = CliRunner().invoke(app, [str(tmp_path)])
    assert "there is no bag at" in str(done.exception)


def test_without_ground_truth_the_sentence_says_what_would_serve(tmp_path, model, app):
    bag = write_drive(tmp_path / "drive", with_depth=False)
    done = CliRunner().invoke(app, [str(bag), "--model", str(model)])
    assert isinstance(done.exception, EvaluationError)
    for part in ("drive", "/camera/image_raw", "/radar/points", "LiDAR", "32FC1", "--depth"):
        assert part in str(done.exception)


def test_ground_truth_that_fits_no_image_is_refused(tmp_path, loaded, app):
    bag = write_drive(tmp_path / "drive", depth_delay_ns=10_000_000)
    page = tmp_path / "page.html"
    done = CliRunner().invoke(app, [str(bag), "--report", str(page)])
    assert isinstance(done.exception, EvaluationError)
    assert "must have an image's stamp" in str(done.exception)
    assert not page.exists()


def test_help_has_an_example(app):
    done = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert done.exit_code == 0
    assert "radcam-depth evaluate out/test" in done.stdout


@pytest.mark.parametrize(("options", "threads"), [((), 1), (("--threads", "3"), 3)])
def test_json_says_in_which_format_and_how_many_threads(tmp_path, model, app, options, threads):
    """By default no more threads than torch has, which is one in the tests."""
    bag = write_drive(tmp_path / "drive")
    arguments = [str(bag), "--model", str(model), "--precision", "bfloat16", "--json", "-", "--no-baselines", *options]
    plain = json.loads(CliRunner().invoke(app, arguments).stdout)
    torch.set_num_threads(1)
    assert (plain["precision"], plain["threads"]) == ("bfloat16", threads)
    assert plain["weights_sha256"] == hashlib.sha256(model.read_bytes()).hexdigest()
