"""Names that others gave - topics, frames, fields, paths - are shown and written, never obeyed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import run_main
from small_drive import CAMERA, CAMERA_FROM_RADAR, PERIOD_NS, START_NS, small_image, small_returns

from benchmarks.adversary.bag_files import OBEYED_NAMES
from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.messages import (
    StampedTransform,
    encode_camera_info,
    encode_image,
    encode_points,
    encode_transforms,
)


def hostile_drive(path: Path, name: str) -> Path:
    with BagWriter(path) as writer:
        link = StampedTransform(f"camera{name}", f"radar{name}", START_NS, CAMERA_FROM_RADAR)
        transforms = encode_transforms(factory, [link])
        writer.write("/tf_static", transforms, START_NS - 200_000_000, "tf2_msgs/msg/TFMessage")
        for index in range(4):
            stamp = START_NS + index * PERIOD_NS
            x, y, z = small_returns(index).T
            fields = {"x": x, "y": y, "z": z, f"rcs{name}": np.full(4, 5, np.float32)}
            cloud = encode_points(factory, fields, stamp, f"radar{name}")
            info = encode_camera_info(factory, CAMERA, stamp, f"camera{name}")
            image = encode_image(factory, small_image(index), stamp, f"camera{name}")
            writer.write(f"/radar{name}/points", cloud, stamp, "sensor_msgs/msg/PointCloud2")
            writer.write(f"/camera{name}/image_raw", image, stamp, "sensor_msgs/msg/Image")
            writer.write(f"/camera{name}/camera_info", info, stamp, "sensor_msgs/msg/CameraInfo")
    return path


def is_printable(text: str) -> bool:
    """Whether a text has nothing that a terminal obeys; rich's own colours are off where no terminal is."""
    return all(letter.isprintable() or letter in "\n\t" for letter in text)


@pytest.mark.parametrize("name", OBEYED_NAMES)
def test_inspect_shows_and_writes_them(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, target = hostile_drive(tmp_path / "drive.mcap", name), tmp_path / "node.yaml"
    assert run_main(monkeypatch, "inspect", drive, "--write-params", target) == 0
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    assert is_printable(shown.out + shown.err)
    text = target.read_text(encoding="utf-8")
    assert is_printable(text)
    (parameters,) = [section["ros__parameters"] for section in yaml.safe_load(text).values()]
    assert "model_file" not in parameters
    assert parameters["image_topic"] == f"/camera{name}/image_raw"
    assert run_main(monkeypatch, "inspect", drive, "--json", "-") == 0
    out = capsys.readouterr().out
    assert is_printable(out)
    assert json.loads(out)


@pytest.mark.parametrize("name", OBEYED_NAMES)
def test_replay_and_check_calibration_show_them(
    name: str, tmp_path: Path, small_weights: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = hostile_drive(tmp_path / "drive.mcap", name)
    assert run_main(monkeypatch, "replay", drive, tmp_path / "out.mcap", "--model", small_weights) == 0
    assert run_main(monkeypatch, "replay", drive, tmp_path / "b.mcap", "--radar", name, "--model", small_weights) == 2
    assert run_main(monkeypatch, "check-calibration", drive) in (0, 1)
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    assert is_printable(shown.out + shown.err)


def test_a_path_may_hold_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in OBEYED_NAMES:
        missing = tmp_path / name.replace("/", "_").replace("\x00", "")
        for verb in ("inspect", "evaluate", "check-calibration"):
            assert run_main(monkeypatch, verb, missing) == 2
        shown = capsys.readouterr()
        assert is_printable(shown.out + shown.err)
        assert "Traceback" not in shown.err
