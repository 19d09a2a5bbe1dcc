"""TruckScenes by the same importer: nuScenes' schema with other sensors, files and no log."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run_main

from radcam_depth_ros.bags import BagReader, read_scenario
from radcam_depth_ros.datasets.clouds import read_floats, read_pcd, unpack_lzf
from radcam_depth_ros.datasets.errors import DatasetError
from radcam_depth_ros.datasets.layout import NUSCENES_RADAR
from radcam_depth_ros.datasets.pcd_file import pcd_file
from radcam_depth_ros.drive import DriveSettings, read_samples

VERSION = "v1.0-mini"
CHANNELS = {
    "CAM_FRONT": "CAMERA_LEFT_FRONT",
    "CAM_BACK": "CAMERA_RIGHT_BACK",
    "RADAR_FRONT": "RADAR_LEFT_FRONT",
    "RADAR_FRONT_LEFT": "RADAR_LEFT_SIDE",
    "RADAR_BACK_RIGHT": "RADAR_RIGHT_BACK",
    "RADAR_BACK_LEFT": "RADAR_LEFT_BACK",
    "LIDAR_TOP": "LIDAR_TOP_FRONT",
}


def packed(content: bytes) -> bytes:
    """LZF without anything that repeats: runs of up to 32 bytes."""
    parts = (content[start : start + 32] for start in range(0, len(content), 32))
    return b"".join(bytes([len(part) - 1]) + part for part in parts)


def compressed(content: bytes) -> bytes:
    """A binary PCD as a compressed one."""
    header, _, body = content.partition(b"DATA binary\n")
    words = {line.split()[0]: line.split()[1:] for line in header.decode().splitlines() if not line.startswith("#")}
    kinds = {"F": "f", "I": "i", "U": "u"}
    dtype = np.dtype(
        [
            (name, f"<{kinds[kind]}{size}")
            for name, kind, size in zip(words["FIELDS"], words["TYPE"], words["SIZE"], strict=True)
        ]
    )
    points = np.frombuffer(body, dtype, int(words["WIDTH"][0]))
    columns = b"".join(np.ascontiguousarray(points[name]).tobytes() for name in dtype.names or ())
    small = packed(columns)
    sizes = len(small).to_bytes(4, "little") + len(columns).to_bytes(4, "little")
    return header + b"DATA binary_compressed\n" + sizes + small


@pytest.fixture(scope="module")
def truckscenes(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small data set with TruckScenes' names, point files and tables."""
    root = Path(shutil.copytree(whole_set, tmp_path_factory.mktemp("truckscenes") / "set"))
    tables = {path.stem: json.loads(path.read_text()) for path in (root / VERSION).glob("*.json")}
    for row in tables["sensor"]:
        row["channel"] = CHANNELS[row["channel"]]
    for row in tables["ego_pose"]:
        row["translation"] = [row["translation"][0] + 6e5, row["translation"][1] + 5.3e6, row["translation"][2]]
    for index, row in enumerate(tables["scene"]):
        row["log_token"] = ""
        row["description"] = "weather.rain;area.highway;daytime.night" if index else "weather.clear;area.city"
    for row in tables["sample_data"]:
        old = root / row["filename"]
        if old.suffix == ".jpg":
            continue
        row["filename"] = row["filename"].removesuffix(".bin")
        content = old.read_bytes()
        old.unlink()
        if "LIDAR" in row["filename"]:
            columns: Any = read_floats(content, "", ("x", "y", "z", "intensity", "ring"))
            columns["timestamp"] = np.full(len(columns["x"]), row["timestamp"], np.uint64)
        else:
            radar = read_pcd(content, "", NUSCENES_RADAR)
            columns = {name: radar[name] for name in ("x", "y", "z")}
            columns |= {"vrel_x": radar["vx"], "vrel_y": radar["vy"], "vrel_z": radar["z"] * 0, "rcs": radar["rcs"]}
        (root / row["filename"]).write_bytes(
            compressed(pcd_file(columns)) if row["is_key_frame"] else pcd_file(columns)
        )
    for name, rows in tables.items():
        (root / VERSION / f"{name}.json").write_text(json.dumps(rows))
    (root / VERSION / "log.json").unlink()
    return root


def test_scenes_come_like_those_of_nuscenes(truckscenes: Path, tmp_path: Path, monkeypatch: Any) -> None:
    out = tmp_path / "out"
    code = run_main(monkeypatch, "import", "truckscenes", truckscenes, out, "--version", VERSION, "--radars", "all")
    assert code == 0
    with BagReader(out / "scene-0001.mcap") as reader:
        names = {info.name for info in reader.topics}
        scenario = read_scenario(reader)
    assert {"/camera/left_front/image_raw/compressed", "/radar/left_front/points", "/lidar/points"} < names
    assert (scenario["dataset"], scenario["radar"]) == ("TruckScenes", "/radar/left_front/points")
    with BagReader(out / "scene-0002.mcap") as reader:
        scenario = read_scenario(reader)
    assert (scenario["time_of_day"], scenario["weather"]) == ("night", "rain")


def test_the_same_depth_and_returns_as_from_nuscenes(
    truckscenes: Path, whole_set: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    samples = []
    for name, root in (("nuscenes", whole_set), ("truckscenes", truckscenes)):
        options = ("--version", VERSION, "--scenes", "scene-0001")
        assert run_main(monkeypatch, "import", name, root, tmp_path / name, *options) == 0
        settings = DriveSettings(ground_truth="lidar")
        samples.append(list(read_samples(tmp_path / name / "scene-0001.mcap", settings)))
    assert len(samples[0]) == len(samples[1]) > 10
    for one, other in zip(*samples, strict=True):
        np.testing.assert_allclose(one.depth_m, other.depth_m, atol=1e-3)
        np.testing.assert_array_equal(one.frame.radar.xyz_m, other.frame.radar.xyz_m)
        np.testing.assert_array_equal(one.frame.radar.radial_speed_mps, other.frame.radar.radial_speed_mps)
        assert one.frame.ground.is_known
        assert not other.frame.ground.is_known  # the schema does not say where the road is


def test_the_splits_of_nuscenes_are_refused(truckscenes: Path, tmp_path: Path, monkeypatch: Any, capfd: Any) -> None:
    options = ("--version", VERSION, "--split", "val")
    assert run_main(monkeypatch, "import", "truckscenes", truckscenes, tmp_path / "out", *options) == 2
    assert "--scenes" in capfd.readouterr().err


def test_each_set_refuses_the_tables_of_the_other(
    truckscenes: Path, whole_set: Path, tmp_path: Path, monkeypatch: Any, capfd: Any
) -> None:
    for name, root in (("nuscenes", truckscenes), ("truckscenes", whole_set)):
        assert run_main(monkeypatch, "import", name, root, tmp_path / "out", "--version", VERSION) == 2
        assert "which data set it is" in capfd.readouterr().err


def test_what_repeats_in_compressed_files_is_unpacked() -> None:
    # Literals "abc", a copy of 5 from 3 back, a copy of 16 (7 + 7 + 2) from 1 back: by hand from the format.
    content = bytes([2, *b"abc", (3 << 5) | 0, 2, (7 << 5) | 0, 7, 0])
    assert unpack_lzf(content, 100) == b"abc" + b"abcab" + b"b" * 16
    assert unpack_lzf(content, 6) == b"abcabc"
    assert unpack_lzf(bytes([(1 << 5) | 0, 9]), 10) == b""


def test_compressed_files_that_are_damaged_are_refused() -> None:
    content = compressed(pcd_file({name: np.arange(40, dtype=np.float32) for name in ("x", "y", "z", "intensity")}))
    fields = ("x", "y", "z")
    assert read_pcd(content, "a", fields, exactly=False)["z"].tolist() == list(range(40))
    for damaged in (content[:-20], content.replace(b"WIDTH 40", b"WIDTH 41"), content[: content.index(b"DATA")]):
        with pytest.raises(DatasetError):
            read_pcd(damaged, "a", fields, exactly=False)
