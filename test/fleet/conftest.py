from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.cli.evaluate import evaluate
from radcam_depth_ros.cli.replay import replay
from radcam_depth_ros.cli.terminal.options import load_estimator
from radcam_depth_ros.estimator import Estimator, EstimatorConfig
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

CAMERA = CameraModel(96, 64, 630.0, 630.0, 47.5, 31.5)


@pytest.fixture(scope="session")
def estimator(small_weights: Path) -> Estimator:
    return load_estimator(EstimatorConfig(model_file=str(small_weights), precision="float32", threads=1))


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch, estimator: Estimator) -> None:
    """Loading takes longer than a few frames: it is done once."""
    for verb in (evaluate, replay):
        monkeypatch.setattr(sys.modules[verb.__module__], "load_estimator", lambda *_: estimator)


@pytest.fixture(scope="session")
def write_truth() -> Callable[..., Path]:
    """Writes a drive with ground truth that differs from seed to seed: `write_truth(path, seed, frames=2)`."""

    def write(path: Path, seed: int, frames: int = 2, scenario: dict[str, str] | None = None) -> Path:
        generator = np.random.default_rng(seed)
        link = StampedTransform("camera", "radar", 0, RigidTransform.identity())
        with BagWriter(path) as bag:
            bag.write("/tf_static", encode_transforms(factory, [link]), 0)
            if scenario:
                bag.write("/scenario", factory("std_msgs/msg/String", data=json.dumps(scenario)), 0)
            for index in range(frames):
                stamp = 10**9 + index * 10**8
                depth = generator.uniform(3.0, 70.0, (64, 96)).astype(np.float32)
                depth[:8] = np.inf
                returns = generator.uniform((-1, -0.5, 5), (1, 0.5, 60), (int(generator.integers(1, 9)), 3))
                points: dict[str, Any] = dict(zip("xyz", returns.astype(np.float32).T, strict=True))
                image = generator.integers(0, 255, (64, 96, 3), np.uint8)
                bag.write("/camera/camera_info", encode_camera_info(factory, CAMERA, stamp, "camera"), stamp)
                bag.write("/camera/image_raw", encode_image(factory, image, stamp, "camera"), stamp)
                bag.write("/radar/points", encode_points(factory, points, stamp, "radar"), stamp)
                bag.write("/ground_truth/depth", encode_depth(factory, depth, stamp, "camera"), stamp)
        return path

    return write


@pytest.fixture
def one_thread() -> None:
    torch.set_num_threads(1)
