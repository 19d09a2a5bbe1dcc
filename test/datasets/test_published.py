"""Imported scenes and other drives by the published protocols: which frames, truth, returns and groups."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run_main
from surround_drive import SurroundDrive, mount, pose_at, write_surround_drive

from radcam_depth_ros.bags import BagReader, BagWriter
from radcam_depth_ros.datasets import LAYOUTS, ImportOptions, import_scenes, plan_import
from radcam_depth_ros.drive import DriveError, DriveSettings, read_samples
from radcam_depth_ros.evaluation.measures.protocols import PROTOCOLS
from radcam_depth_ros.evaluation.published import evaluate_published, published_drives
from radcam_depth_ros.frame import DepthResult, Frame
from radcam_depth_ros.messages import decode_points, stamp_ns


@pytest.fixture(scope="module")
def scenes(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    out = tmp_path_factory.mktemp("scenes")
    options = ImportOptions(radars="all")
    plan = plan_import(LAYOUTS["nuscenes"], whole_set, out, options, version="v1.0-mini")
    assert not any(scene.problem for scene in import_scenes(plan))
    return sorted(out.iterdir())


def ten_metres(frame: Frame) -> DepthResult:
    depth = np.full(frame.image.shape[:2], 10.0, np.float32)
    return DepthResult(frame.stamp_ns, frame.frame_id, frame.camera, depth, depth, depth, 0)


def key_frames(bag: Path) -> list[dict[str, int]]:
    with BagReader(bag) as reader:
        return list(json.loads(next(reader.messages(["/scenario"])).message.data)["key_frames"])


def test_key_frames_but_the_last_with_the_radar_ahead(scenes: list[Path]) -> None:
    drives, frames = published_drives(scenes[:1], DriveSettings(), PROTOCOLS["singh2023"])
    samples = list(drives[0].samples)
    expected = [frame["/camera/front/image_raw/compressed"] for frame in key_frames(scenes[0])[:-1]]
    assert [sample.frame.stamp_ns for sample in samples] == expected
    assert frames == len(samples) == 2
    assert all(sample.radars == ("/radar/front/points",) for sample in samples)


def test_truth_is_the_key_frames_own_scan(scenes: list[Path]) -> None:
    """Drawn again, point by point, from the poses that the drive was made with."""
    with BagReader(scenes[0]) as reader:
        scans = {stamp_ns(item.message.header): item.message for item in reader.messages(["/lidar/points"])}
    drives, _ = published_drives(scenes[:1], DriveSettings(), PROTOCOLS["cafnet"])
    for frame, sample in zip(key_frames(scenes[0]), drives[0].samples, strict=False):
        image_ns, scan_ns = frame["/camera/front/image_raw/compressed"], frame["/lidar/points"]
        camera = sample.frame.camera
        at_image = pose_at(image_ns // 1000) @ mount("camera", "front")
        at_scan = pose_at(scan_ns // 1000) @ mount("lidar")
        expected: dict[tuple[int, int], float] = {}
        for point in decode_points(scans[scan_ns]).xyz_m.astype(np.float64):
            world = at_scan.rotation @ point + at_scan.translation
            x, y, z = at_image.rotation.T @ (world - at_image.translation)
            u, v = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy) if z > 1 else (0, 0)
            if 1 < u < camera.width - 1 and 1 < v < camera.height - 1:
                expected[round(v), round(u)] = z
        found = {(row, column): sample.depth_m[row, column] for row, column in np.argwhere(np.isfinite(sample.depth_m))}
        same = found.keys() & expected.keys()
        assert len(same) > 100
        assert len(found.keys() ^ expected.keys()) <= 1  # a point on the edge of a pixel may fall to either side
        errors = np.array([expected[pixel] - found[pixel] for pixel in same])
        assert np.quantile(np.abs(errors), 0.99) < 2 / 256


def test_filters_of_the_devkit(scenes: list[Path]) -> None:
    counts = {}
    for name in ("cafnet", "justdepth"):
        drives, _ = published_drives(scenes[:1], DriveSettings(), PROTOCOLS[name])
        counts[name] = [len(sample.frame.radar) for sample in drives[0].samples]
    expected = []
    with BagReader(scenes[0]) as reader:
        for frame in key_frames(scenes[0])[:-1]:
            for item in reader.messages(["/radar/front/points"]):
                if stamp_ns(item.message.header) == frame["/radar/front/points"]:
                    points = np.frombuffer(bytes(item.message.data), np.uint8).reshape(-1, 43)
                    # Bytes of dyn_prop, ambig_state and invalid_state in the layout of 43 bytes.
                    kept = (points[:, 12] <= 6) & (points[:, 36] == 3) & (points[:, 39] == 0)
                    expected.append((len(points), int(kept.sum())))
    assert list(zip(counts["cafnet"], counts["justdepth"], strict=True)) == expected
    assert sum(kept for _, kept in expected) < sum(counts["cafnet"])


def test_groups_are_day_night_and_rain(scenes: list[Path]) -> None:
    drives, _ = published_drives(scenes, DriveSettings(), PROTOCOLS["justdepth"])
    result = evaluate_published(drives, ten_metres, PROTOCOLS["justdepth"], "ten")
    assert {name: entry.frames[-1] for name, entry in result.groups.items()} == {
        "all": 6, "day": 4, "night": 2, "rain": 2,
    }  # fmt: skip
    assert result.groups["night"] == result.groups["rain"]
    mean = np.average([result.groups[name].mae_m for name in ("day", "night")], axis=0, weights=[4, 2])
    assert result.groups["all"].mae_m == pytest.approx(mean)


def test_any_drive_with_a_lidar_and_motion(tmp_path: Path) -> None:
    bag = write_surround_drive(tmp_path / "drive.mcap", SurroundDrive(3, seconds=0.6))
    drives, frames = published_drives([bag], DriveSettings(), PROTOCOLS["singh2023"])
    result = evaluate_published(drives, ten_metres, PROTOCOLS["singh2023"])
    assert result.frames == frames == 6
    assert result.groups["all"].mae_m[0] > 1


def test_without_motion_there_is_no_truth(surround_drives: Any, tmp_path: Path) -> None:
    with BagReader(surround_drives[0]) as reader, BagWriter(tmp_path / "still.mcap") as writer:
        for message in reader.messages():
            if message.topic != "/odom":
                writer.copy(message)
    drives, _ = published_drives([tmp_path / "still.mcap"], DriveSettings(), PROTOCOLS["cafnet"])
    with pytest.raises(DriveError, match="odometry"):
        list(drives[0].samples)


def test_evaluate_takes_a_protocol(scenes: list[Path], tmp_path: Path, small_weights: Path, monkeypatch: Any) -> None:
    target = tmp_path / "figures.json"
    options = ("--model", small_weights, "--protocol", "cafnet", "--json", target)
    assert run_main(monkeypatch, "evaluate", scenes[0].parent, *options) == 0
    figures = json.loads(target.read_text())
    assert (figures["protocol"], figures["frames"]) == ("cafnet", 6)
    assert set(figures["groups"]) == {"all", "day", "night", "rain"}
    assert run_main(monkeypatch, "evaluate", scenes[0], "--protocol", "eigen") == 2
    assert run_main(monkeypatch, "evaluate", scenes[0], "--protocol", "cafnet", "--clip", "80") == 2


def test_imported_scenes_can_be_read_like_any_drive(scenes: list[Path]) -> None:
    samples = list(read_samples(scenes[0], DriveSettings(accumulate="always", ground_truth="lidar")))
    assert len(samples) == 14
    assert all(sample.frame.ground.is_known for sample in samples)
    assert np.median([np.isfinite(sample.depth_m).sum() for sample in samples]) > 300
