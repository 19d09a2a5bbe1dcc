from __future__ import annotations

import json

import numpy as np
import pytest
import torch
import typer
from typer.testing import CliRunner

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.cli.evaluate import evaluate
from radcam_depth_ros.evaluation.metrics import MEASURES, EvaluationError
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
from radcam_depth_ros.networks import archive, registry

CAMERA = CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5)
FRAMES = 3


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    torch.manual_seed(0)
    network = registry.create("baff")
    path = tmp_path_factory.mktemp("model") / "untrained.safetensors"
    archive.save(network, archive.Card.of(network, "baff", "nothing"), path)
    return path


@pytest.fixture
def app():
    application = typer.Typer()
    application.command()(evaluate)
    return application


def write_drive(path, with_depth=True, depth_delay_ns=0):
    generator = np.random.default_rng(0)
    points = {name: np.array(values, np.float32) for name, values in (("x", [0.1]), ("y", [0.0]), ("z", [20.0]))}
    depth = np.full((64, 96), 25.0, np.float32)
    depth[:8] = np.inf
    link = StampedTransform("camera", "radar", 0, RigidTransform.identity())
    with BagWriter(path) as bag:
        bag.write("/tf_static", encode_transforms(factory, [link]), 0)
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
    assert "evaluating" in done.stderr


def test_a_table_and_files_are_written(tmp_path, model, app):
    bag = write_drive(tmp_path / "drive.mcap")
    page, measures = tmp_path / "out" / "page.html", tmp_path / "out" / "measures.json"
    options = ["--report", str(page), "--json", str(measures), "--limit", "2", "--camera-height", "1.7"]
    done = CliRunner().invoke(app, [str(bag), "--model", str(model), *options])
    assert done.exit_code == 0, done.output
    assert "geometry alone" in done.stdout
    assert "1.70 m (as given)" in done.stdout
    plain = json.loads(measures.read_text(encoding="utf-8"))
    assert plain["frames"] == 2
    assert plain["baselines"]["ground_nearest"]["camera_height_source"] == "given"
    assert "error of the dense depth" in page.read_text(encoding="utf-8")


def test_without_ground_truth_the_sentence_says_what_would_serve(tmp_path, model, app):
    bag = write_drive(tmp_path / "drive", with_depth=False)
    done = CliRunner().invoke(app, [str(bag), "--model", str(model)])
    assert isinstance(done.exception, EvaluationError)
    for part in ("drive", "/camera/image_raw", "/radar/points", "LiDAR", "32FC1", "--depth"):
        assert part in str(done.exception)


def test_ground_truth_that_fits_no_image_is_refused(tmp_path, model, app):
    bag = write_drive(tmp_path / "drive", depth_delay_ns=10_000_000)
    page = tmp_path / "page.html"
    done = CliRunner().invoke(app, [str(bag), "--model", str(model), "--report", str(page)])
    assert isinstance(done.exception, EvaluationError)
    assert "must have an image's stamp" in str(done.exception)
    assert not page.exists()


def test_help_has_an_example(app):
    done = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert done.exit_code == 0
    assert "radcam-depth evaluate out/test" in done.stdout
