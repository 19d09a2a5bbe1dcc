"""nuScenes' own devkit loads what `export-dataset` writes, and agrees with the imported bags.

It wants numpy < 2, so an environment of its own: `python -m venv ENV && ENV/bin/pip install "numpy<2"
nuscenes-devkit==1.2.0`, then `NUSCENES_DEVKIT_PYTHON=ENV/bin/python pytest test/datasets`.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radcam_depth_ros.bags import BagReader, read_static_transforms
from radcam_depth_ros.datasets import LAYOUTS, ImportOptions, import_scenes, plan_import
from radcam_depth_ros.drive import DriveSettings, read_samples
from radcam_depth_ros.frame_builder import FrameBuilderConfig
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.messages import Calibration, decode_odometry, decode_points, stamp_ns
from radcam_depth_ros.pairing import PairingConfig

SWEEPS = 4
SCENES = ("scene-0001", "scene-0002", "scene-0003")
DEVKIT = os.environ.get("NUSCENES_DEVKIT_PYTHON", "")
pytestmark = pytest.mark.skipif(
    not DEVKIT, reason="NUSCENES_DEVKIT_PYTHON names no Python of an environment with nuscenes-devkit 1.2.0"
)


@pytest.fixture(scope="module")
def reference(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Any]:
    out = tmp_path_factory.mktemp("devkit") / "reference.npz"
    script = Path(__file__).with_name("devkit_reference.py")
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [DEVKIT, str(script), str(whole_set), str(out), str(SWEEPS)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=250, check=False)
    assert done.returncode == 0, done.stderr
    return dict(np.load(out))


@pytest.fixture(scope="module")
def bags(whole_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bags")
    plan = plan_import(LAYOUTS["nuscenes"], whole_set, out, ImportOptions(), version="v1.0-mini")
    assert not any(scene.problem for scene in import_scenes(plan))
    return out


class Scene:
    """The parts of an imported bag that place points in the image."""

    def __init__(self, bag: Path) -> None:
        with BagReader(bag) as reader:
            self.key_frames = json.loads(next(reader.messages(["/scenario"])).message.data)["key_frames"]
            self.tree = read_static_transforms(reader)
            self.camera = Calibration(next(reader.messages(["/camera/front/camera_info"])).message).camera
            self.poses = {
                stamp_ns(item.message.header): decode_odometry(item.message).pose for item in reader.messages(["/odom"])
            }
            self.clouds = {
                (item.topic, stamp_ns(item.message.header)): decode_points(item.message)
                for item in reader.messages(["/lidar/points", "/radar/front/points"])
            }

    def pose(self, stamp: int, frame: str) -> RigidTransform:
        return self.poses[stamp] @ self.tree.lookup("base_footprint", frame)

    def in_image(self, topic: str, key_frame: Mapping[str, int]) -> np.ndarray:
        """(N, 3) column, row and depth of the points that the devkit keeps."""
        image_ns, cloud_ns = key_frame["/camera/front/image_raw/compressed"], key_frame[topic]
        cloud = self.clouds[topic, cloud_ns]
        moved = self.pose(image_ns, "cam_front").inverse() @ self.pose(cloud_ns, cloud.frame_id)
        x, y, z = moved.apply(cloud.xyz_m).T.astype(np.float64)
        camera = self.camera
        with np.errstate(divide="ignore"):
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        kept = (z > 1) & (u > 1) & (u < camera.width - 1) & (v > 1) & (v < camera.height - 1)
        return np.stack([u, v, z], axis=1)[kept]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    ("kind", "topic", "least"), [("lidar", "/lidar/points", 200), ("radar", "/radar/front/points", 3)]
)
def test_projections_agree_on_every_point(
    reference: Mapping[str, Any], bags: Path, name: str, kind: str, topic: str, least: int
) -> None:
    scene = Scene(bags / f"{name}.mcap")
    worst = np.zeros(3)
    assert len(scene.key_frames) == 3
    for frame in scene.key_frames:
        theirs = reference[f"{kind}/{name}/{frame['/camera/front/image_raw/compressed'] // 1000}"].T
        ours = scene.in_image(topic, frame)
        assert len(ours) == len(theirs) >= least
        worst = np.maximum(worst, np.abs(ours - theirs).max(axis=0))
    print(f"{name} {kind}: at most {worst[:2].max():.6f} px and {1000 * worst[2]:.6f} mm apart")
    assert worst[:2].max() < 0.05
    assert worst[2] < 0.001


@pytest.mark.parametrize("name", SCENES)
def test_several_radar_sweeps_agree(reference: Mapping[str, Any], bags: Path, name: str) -> None:
    config = FrameBuilderConfig(pairing=PairingConfig(radar_sweeps=SWEEPS))
    scene = Scene(bags / f"{name}.mcap")
    sweeps = sorted(stamp for topic, stamp in scene.clouds if topic == "/radar/front/points")
    compared, worst = 0, 0.0
    for sample in read_samples(bags / f"{name}.mcap", DriveSettings(config, ground_truth="none")):
        stamp = sample.frame.stamp_ns
        key = [frame for frame in scene.key_frames if frame["/camera/front/image_raw/compressed"] == stamp]
        nearest = min(sweeps, key=lambda sweep: abs(sweep - stamp))
        # The devkit starts from the key frame's own sweep, the frame builder from the one nearest to the image.
        if not key or key[0]["/radar/front/points"] != nearest:
            continue
        theirs = reference[f"sweeps/{name}/{stamp // 1000}"].T
        theirs = theirs[np.isfinite(theirs).all(axis=1)]
        ours = sample.frame.radar.xyz_m
        assert len(ours) == len(theirs)
        distance = np.linalg.norm(ours[:, None] - theirs[None], axis=2)
        worst = max(worst, float(distance.min(axis=0).max()), float(distance.min(axis=1).max()))
        compared += 1
    print(f"{name}: {compared} key frames, returns at most {1000 * worst:.3f} mm apart")
    assert compared >= 1
    assert worst < 0.001
