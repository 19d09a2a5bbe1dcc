from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from small_drive import CAMERA, PERIOD_NS, START_NS

from demo.measure import CAMERA_INFO, CONFIDENCE, DEPTH, SEMI_DENSE, Traffic, measure, write_page
from demo.plan import plan_drive
from radcam_depth_ros.bags import BagWriter, factory
from radcam_depth_ros.messages import encode_camera_info, encode_confidence, encode_depth


def write_recording(path: Path, depths_m: dict[int, float]) -> Path:
    """Depth that is the same all over, of some of the small drive's frames."""
    with BagWriter(path) as writer:
        for index, depth_m in depths_m.items():
            stamp_ns = START_NS + index * PERIOD_NS
            dense = np.full((CAMERA.height, CAMERA.width), depth_m, np.float32)
            semi_dense, confidence = np.full_like(dense, np.nan), np.full_like(dense, 0.5)
            where = (stamp_ns, "camera")
            writer.write(DEPTH, encode_depth(factory, dense, *where), stamp_ns)
            writer.write(SEMI_DENSE, encode_depth(factory, semi_dense, *where), stamp_ns)
            writer.write(CAMERA_INFO, encode_camera_info(factory, CAMERA, *where), stamp_ns)
            writer.write(CONFIDENCE, encode_confidence(factory, confidence, *where), stamp_ns)
    return path


def test_a_recording_is_measured(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    plan = plan_drive(write_drive(tmp_path / "drive.mcap"))
    recording = write_recording(tmp_path / "depth.mcap", {index: 11.0 + index for index in range(4)})
    evaluation, keeper = measure(plan, recording)
    assert evaluation.frames == 5
    assert evaluation.frames_missing == 1
    assert abs(evaluation.dense.within(80).mae - 1.0) < 1e-5
    traffic = Traffic(dict.fromkeys(range(5), 0.0), dict.fromkeys(range(4), 0.2))
    write_page(tmp_path / "report.html", plan, traffic, evaluation, keeper)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "drive through the live node" in page
    assert "data:image/png" in page


def test_traffic_is_counted() -> None:
    traffic = Traffic({1: 10.0, 2: 20.0, 3: 30.0}, {1: 10.1, 2: 20.3})
    assert traffic.dropped == 1
    assert traffic.table().rows == (("live", "3", "2", "1", "200", "298"),)


def test_no_traffic_has_a_table_too() -> None:
    assert Traffic({1: 10.0}, {}).table().rows == (("live", "1", "0", "1", "nan", "nan"),)
