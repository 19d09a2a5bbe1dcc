from __future__ import annotations

import itertools
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
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
from radcam_depth_ros.storage import transfers

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


class Faulty:
    """Every n-th GET of an object fails, in turns by an answer and by a stall; writes to `readonly` are forbidden."""

    def __init__(self, application: Any) -> None:
        self._application, self._count = application, itertools.count(1)
        self.every, self.stall_s, self.failed = 0, 1.0, 0

    def __call__(self, environment: Any, start: Any) -> Any:
        path, method = environment["PATH_INFO"], environment["REQUEST_METHOD"]
        if method == "PUT" and path.startswith("/readonly/"):
            start("403 Forbidden", [("Content-Type", "application/xml")])
            return [b"<Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>"]
        if self.every and method == "GET" and path.endswith(".mcap") and not next(self._count) % self.every:
            self.failed += 1
            if self.failed % 2:
                time.sleep(self.stall_s)
            start("403 Forbidden" if path.endswith("never.mcap") else "500 Internal Server Error", [])
            return [b""]
        return self._application(environment, start)


@pytest.fixture(scope="session")
def s3_server() -> Iterator[Faulty]:
    """moto's S3 server on loopback, which this process and those that it starts use."""
    pytest.importorskip("s3fs", reason="the extra fleet is not installed")
    pytest.importorskip("moto", reason="pip install moto[server]")
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import make_server

    faulty = Faulty(DomainDispatcherApplication(create_backend_app))
    server = make_server("127.0.0.1", 0, faulty, threaded=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_CONFIG_FILE": "/dev/null",
            "AWS_EC2_METADATA_DISABLED": "true",
        }.items():
            patch.setenv(name, value)
        yield faulty
    server.shutdown()
    thread.join()


@pytest.fixture
def s3(s3_server: Faulty) -> Iterator[tuple[Any, Faulty]]:
    """fsspec's file system of the server, with the empty buckets `fleet` and `readonly`, and its faults."""
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    s3_server.every = 0
    system, _ = transfers.file_system("s3://fleet")
    for bucket in ("fleet", "readonly"):
        if not system.exists(bucket):
            system.mkdir(bucket)
    system.invalidate_cache()
    yield system, s3_server
    s3_server.every = 0
    if system.exists("fleet/"):
        system.rm("fleet", recursive=True)
    s3fs.S3FileSystem.clear_instance_cache()
