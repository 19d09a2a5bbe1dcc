"""Time and memory of importing one scene out of tables as large as those of nuScenes v1.0-trainval.

    python -m benchmarks.tables --folder out/tables

Generates tables of 850 scenes with 34,149 samples and 2,631,083 rows of sample_data and ego_pose each, about 2 GB on
the disk, and the files of one scene; then imports that scene in a process of its own, and in another one reads what
the tables say of all scenes. `--scenes 20` makes smaller ones.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from radcam_depth_ros.datasets.layout import NUSCENES, NUSCENES_RADAR, ImportOptions
from radcam_depth_ros.datasets.pcd_file import pcd_file
from radcam_depth_ros.datasets.tables import Tables

SCENES, SAMPLES, READINGS = 850, 34_149, 2_631_083
VERSION = "v1.0-trainval"
_CAMERAS = tuple(f"CAM_{place}" for place in ("FRONT", "FRONT_RIGHT", "BACK_RIGHT", "BACK", "BACK_LEFT", "FRONT_LEFT"))
_RADARS = tuple(f"RADAR_{place}" for place in ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "BACK_LEFT", "BACK_RIGHT"))
CHANNELS = (*_CAMERAS, *_RADARS, "LIDAR_TOP")
_START_US = 1_533_151_603_500_000


def generate(root: Path, scenes: int) -> None:
    """Writes the tables of so many scenes, and the files of the first one."""
    folder = root / VERSION
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"scene-{index:04d}" for index in range(scenes)]
    _table(folder / "log.json", ({"token": _token(0, 0), "location": "nowhere"} for _ in range(1)))
    _table(
        folder / "scene.json",
        (
            {"token": _token(1, index), "name": name, "description": "", "log_token": _token(0, 0)}
            for index, name in enumerate(names)
        ),
    )
    _table(
        folder / "sensor.json",
        (
            {"token": _token(2, index), "channel": channel, "modality": _modality(channel)}
            for index, channel in enumerate(CHANNELS)
        ),
    )
    _table(folder / "calibrated_sensor.json", _calibrated(scenes))
    samples, readings = SAMPLES * scenes // SCENES, READINGS * scenes // SCENES
    per_scene = _bounds(samples, scenes)
    _table(
        folder / "sample.json",
        (
            {"token": _token(4, sample), "timestamp": 0, "prev": "", "next": "", "scene_token": _token(1, index)}
            for index, (first, last) in enumerate(pairwise(per_scene))
            for sample in range(first, last)
        ),
    )
    _table(folder / "sample_data.json", _sample_data(scenes, per_scene, _bounds(readings, scenes)))
    _table(folder / "ego_pose.json", _ego_poses(_bounds(readings, scenes)))
    _files(root, folder)


def _modality(channel: str) -> str:
    return {"CAM": "camera", "RADAR": "radar", "LIDAR": "lidar"}[channel.partition("_")[0]]


def _token(table: int, index: int) -> str:
    return f"{(table << 96) + index * 0x9E3779B97F4A7C15:032x}"


def _bounds(count: int, parts: int) -> list[int]:
    return [count * part // parts for part in range(parts + 1)]


def _calibrated(scenes: int) -> Iterator[dict[str, object]]:
    matrix = [[1266.4, 0.0, 816.3], [0.0, 1266.4, 491.5], [0.0, 0.0, 1.0]]
    for scene in range(scenes):
        for index, channel in enumerate(CHANNELS):
            is_camera = _modality(channel) == "camera"
            yield {
                "token": _token(3, scene * len(CHANNELS) + index),
                "sensor_token": _token(2, index),
                "translation": [1.7, 0.0, 1.5],
                "rotation": [0.5, -0.5, 0.5, -0.5] if is_camera else [1.0, 0.0, 0.0, 0.0],
                "camera_intrinsic": matrix if is_camera else [],
            }


def _sample_data(scenes: int, samples: list[int], readings: list[int]) -> Iterator[dict[str, object]]:
    for scene in range(scenes):
        first, last = readings[scene], readings[scene + 1]
        count = samples[scene + 1] - samples[scene]
        for index in range(first, last):
            channel = CHANNELS[(index - first) % len(CHANNELS)]
            time_us = _time_us(index - first)
            is_camera = _modality(channel) == "camera"
            place = (index - first) * count // (last - first)
            yield {
                "token": _token(5, index),
                "sample_token": _token(4, samples[scene] + place),
                "ego_pose_token": _token(5, index),
                "calibrated_sensor_token": _token(3, scene * len(CHANNELS) + CHANNELS.index(channel)),
                "timestamp": time_us,
                "fileformat": "jpg" if is_camera else "pcd",
                "is_key_frame": (index - first) % 78 < len(CHANNELS),
                "height": 900 if is_camera else 0,
                "width": 1600 if is_camera else 0,
                "filename": f"sweeps/{channel}/n015-2018-07-24-11-22-45+0800-{scene:04d}__{channel}__{time_us}.bin",
                "prev": _token(5, index - 1) if index > first else "",
                "next": _token(5, index + 1) if index + 1 < last else "",
            }


def _time_us(index: int) -> int:
    return _START_US + index * 6_450


def _ego_poses(readings: list[int]) -> Iterator[dict[str, object]]:
    for first, last in pairwise(readings):
        for index in range(first, last):
            yield {
                "token": _token(5, index),
                "timestamp": _time_us(index - first),
                "rotation": [0.5720320396729045, -0.0016977771610471074, 0.011798001930183783, -0.8201446642457809],
                "translation": [411.3039349319818 + 0.05 * (index - first), 1180.8903791765097, 0.0],
            }


def _table(path: Path, rows: Iterator[dict[str, object]]) -> None:
    with path.open("w", encoding="utf-8") as file:
        for index, row in enumerate(rows):
            file.write(("[\n" if not index else ",\n") + json.dumps(row, indent=0))
        file.write("\n]")


def _files(root: Path, folder: Path) -> None:
    """Small files for the readings of the first scene."""
    jpeg = cv2.imencode(".jpg", np.zeros((900, 1600, 3), np.uint8))[1].tobytes()
    radar = pcd_file({name: np.ones(50, np.float32) for name in NUSCENES_RADAR})
    lidar = np.ones((30_000, 5), np.float32).tobytes()
    content = {"camera": jpeg, "radar": radar, "lidar": lidar}
    readings = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    for row in _sample_data(1, _bounds(40, 1), _bounds(READINGS // SCENES, 1)) if readings else ():
        path = root / str(row["filename"])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content[_modality(str(row["filename"]).split("/")[1])])


def main() -> None:
    """Generates the tables where they are missing, imports one scene, and prints time and memory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("out/tables"), help="where the tables are kept")
    parser.add_argument("--scenes", type=int, default=SCENES, help="how many scenes the tables have")
    parser.add_argument("--records-only", action="store_true", help="only read what the tables say of all scenes")
    options = parser.parse_args()
    root = options.folder / str(options.scenes)
    if not (root / VERSION / "ego_pose.json").is_file():
        shutil.rmtree(root, ignore_errors=True)
        generate(root, options.scenes)
    size = sum(path.stat().st_size for path in (root / VERSION).iterdir())
    out = options.folder / "bags"
    if options.records_only:
        records = Tables(root, VERSION).records
        scenes = sum(1 for _ in records(Tables(root, VERSION).scenes, NUSCENES, ImportOptions("all", "all", _CAMERAS)))
        print(f"what the tables say of {scenes} scenes, all sensors: {_peak_mib(resource.RUSAGE_SELF):.0f} MiB")
        return
    shutil.rmtree(out, ignore_errors=True)
    start = time.perf_counter()
    command = [sys.executable, "-m", "radcam_depth_ros.cli", "import", "nuscenes", str(root), str(out)]
    subprocess.run([*command, "--scenes", "scene-0000"], check=True)
    seconds, peak_mib = time.perf_counter() - start, _peak_mib(resource.RUSAGE_CHILDREN)
    print(f"{options.scenes} scenes, tables of {size / 1e9:.2f} GB: one scene in {seconds:.1f} s, {peak_mib:.0f} MiB")
    again = ["--records-only", "--folder", str(options.folder), "--scenes", str(options.scenes)]
    subprocess.run([sys.executable, "-m", "benchmarks.tables", *again], check=True)


def _peak_mib(who: int) -> float:
    return resource.getrusage(who).ru_maxrss / 1024


if __name__ == "__main__":
    main()
