"""A drive, written in the schema of nuScenes and imported again, says the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radcam_depth_ros import simulation
from radcam_depth_ros.bags import BagReader, read_static_transforms
from radcam_depth_ros.datasets import LAYOUTS, ImportOptions, export_nuscenes, import_scenes, plan_import
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.messages import decode_odometry, stamp_ns

VERSION = "v1.0-mini"


def import_all(root: Path, out: Path, options: ImportOptions | None = None, **choice: Any) -> Path:
    plan = plan_import(LAYOUTS["nuscenes"], root, out, options or ImportOptions(), version=VERSION, **choice)
    results = import_scenes(plan)
    assert [scene.problem for scene in results] == [""] * len(results)
    return out


def messages(bag: Path, topic: str) -> dict[int, Any]:
    with BagReader(bag) as reader:
        return {stamp_ns(item.message.header): item.message for item in reader.messages([topic])}


@pytest.fixture(scope="module")
def imported(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    options = ImportOptions(radars="all", cameras=("CAM_FRONT",))
    return import_all(whole_set, tmp_path_factory.mktemp("imported"), options)


@pytest.mark.parametrize("index", range(3))
def test_images_and_returns_are_the_same_byte_for_byte(imported: Path, surround_drives: Any, index: int) -> None:
    bag = imported / f"scene-{index + 1:04d}.mcap"
    with BagReader(bag) as reader:
        clouds = [info.name for info in reader.topics if info.type_name.endswith("PointCloud2")]
    assert len(clouds) == (4, 2, 3)[index]
    for topic in ("/camera/front/image_raw/compressed", *clouds):
        before, after = messages(surround_drives[index], topic), messages(bag, topic)
        assert list(before) == list(after)
        for stamp, message in after.items():
            assert bytes(message.data) == bytes(before[stamp].data)
            assert message.header.frame_id == before[stamp].header.frame_id


def test_an_empty_sweep_stays_empty(imported: Path) -> None:
    clouds = messages(imported / "scene-0002.mcap", "/radar/front/points").values()
    assert [index for index, cloud in enumerate(clouds) if cloud.width == 0] == [4]


def test_radars_keep_their_layout_of_43_bytes(imported: Path) -> None:
    cloud = next(iter(messages(imported / "scene-0001.mcap", "/radar/front/points").values()))
    assert cloud.point_step == 43
    assert len(cloud.fields) == 18


def test_transforms_and_poses_are_the_same(imported: Path, surround_drives: Any) -> None:
    with BagReader(surround_drives[0]) as before, BagReader(imported / "scene-0001.mcap") as after:
        known, found = read_static_transforms(before), read_static_transforms(after)
    for frame in ("cam_front", "radar_front", "radar_front_left", "lidar_top"):
        pose, other = known.lookup("base_footprint", frame), found.lookup("base_footprint", frame)
        assert np.abs(pose.rotation - other.rotation).max() < 1e-6
        assert np.abs(pose.translation - other.translation).max() < 1e-6
    told, kept = (messages(bag, "/odom") for bag in (surround_drives[0], imported / "scene-0001.mcap"))
    assert len(kept) > 80
    for stamp, message in kept.items():
        pose, other = decode_odometry(told[stamp]).pose, decode_odometry(message).pose
        assert np.abs(pose.rotation - other.rotation).max() < 1e-6
        assert np.abs(pose.translation - other.translation).max() < 1e-6


def test_speeds_are_those_of_the_vehicle(imported: Path) -> None:
    readings = [decode_odometry(message) for message in messages(imported / "scene-0001.mcap", "/odom").values()]
    assert np.allclose([reading.linear[0] for reading in readings], 10.0, atol=0.3)
    assert np.allclose([reading.angular[2] for reading in readings], 0.1, atol=0.02)


def scenario(bag: Path) -> dict[str, Any]:
    with BagReader(bag) as reader:
        return dict(json.loads(next(reader.messages(["/scenario"])).message.data))


def test_the_scenario_tells_split_weather_and_key_frames(imported: Path) -> None:
    dry, wet = scenario(imported / "scene-0001.mcap"), scenario(imported / "scene-0002.mcap")
    assert (dry["time_of_day"], dry["weather"], wet["time_of_day"], wet["weather"]) == ("day", "dry", "night", "rain")
    assert (dry["scene"], dry["split"], dry["version"]) == ("scene-0001", "train", VERSION)
    images = messages(imported / "scene-0001.mcap", "/camera/front/image_raw/compressed")
    assert len(dry["key_frames"]) == 3
    for frame in dry["key_frames"]:
        assert frame["/camera/front/image_raw/compressed"] in images
        apart = [abs(stamp - frame["/lidar/points"]) for stamp in frame.values()]
        assert max(apart) < 60_000_000


def test_key_frames_alone_and_one_radar(whole_set: Path, tmp_path: Path) -> None:
    out = import_all(whole_set, tmp_path / "out", ImportOptions(images="keyframes"), names=("scene-0001",))
    with BagReader(out / "scene-0001.mcap") as reader:
        counts = {info.name: info.count for info in reader.topics}
    assert counts["/camera/front/image_raw/compressed"] == counts["/camera/front/camera_info"] == 3
    assert counts["/lidar/points"] > 20
    assert [name for name in counts if "radar" in name] == ["/radar/front/points"]


def test_depth_truth_agrees_with_the_exact_depth(tmp_path: Path) -> None:
    camera = simulation.CameraConfig(
        width=160, height=96, min_focal_length_px=126.0, max_focal_length_px=126.0, edge_samples=0
    )
    config = simulation.SimulationConfig(camera=camera)
    bag = tmp_path / "drive.mcap"
    simulation.simulate(config, 3, 8, bag)
    export_nuscenes([bag], tmp_path / "set")
    out = import_all(tmp_path / "set", tmp_path / "out")
    exact = {sample.frame.stamp_ns // 1000: sample.depth_m for sample in read_samples(bag)}
    errors = []
    for sample in read_samples(out / "scene-0001.mcap", DriveSettings(ground_truth="lidar")):
        truth = exact[sample.frame.stamp_ns // 1000]
        both = np.isfinite(sample.depth_m) & np.isfinite(truth)
        errors.append(np.abs(sample.depth_m - truth)[both])
    assert len(errors) >= 5
    found = np.concatenate(errors)
    assert len(found) > 1000
    assert np.median(found) < 0.1
