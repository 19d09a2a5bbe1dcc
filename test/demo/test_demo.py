"""The demo as a user starts it: a live node, over DDS."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from small_drive import PERIOD_NS, START_NS

from radcam_depth_ros.bags import BagReader

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 240

pytestmark = pytest.mark.timeout(TIMEOUT_S + 20)


def run_demo(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "demo", *map(str, arguments)]
    # Without a domain from outside it takes one of its own, in which no node of another test is heard.
    environment = {name: value for name, value in os.environ.items() if name != "ROS_DOMAIN_ID"}
    environment["OMP_NUM_THREADS"] = "1"
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )


def test_every_image_gets_a_depth_image(write_drive: Callable[..., Path], small_weights: Path, tmp_path: Path) -> None:
    drive, out = write_drive(tmp_path / "drive.mcap"), tmp_path / "out"
    done = run_demo("--bag", drive, "--model", small_weights, "--out", out)
    assert done.returncode == 0, done.stderr
    with BagReader(out / "depth.mcap") as reader:
        stamps_ns = [message.log_time_ns for message in reader.messages(["/depth/image_rect"])]
        counts = {topic.name: topic.count for topic in reader.topics}
    assert stamps_ns == [START_NS + index * PERIOD_NS for index in range(5)]
    assert counts["/semi_dense/image_rect"] == counts["/depth/camera_info"] == counts["/depth/confidence"] == 5
    assert (out / "report.html").is_file()
    for word in ("frames in", "latency p50", "dense", "semi-dense", "geometry alone", "MAE"):
        assert word in done.stdout


def test_a_node_that_cannot_start_is_one_sentence(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    weights = tmp_path / "foreign.safetensors"
    weights.write_bytes(b"no weights")
    drive, out = write_drive(tmp_path / "drive.mcap"), tmp_path / "out"
    done = run_demo("--bag", drive, "--model", weights, "--out", out)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("demo: the node cannot start: ")
    assert "foreign" in done.stderr
    assert not (out / "depth.mcap").exists()


def test_a_bag_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    done = run_demo("--bag", tmp_path / "none.mcap", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"demo: there is no bag at {tmp_path / 'none.mcap'}; " + (
        "give a rosbag2 folder or an .mcap file"
    )
