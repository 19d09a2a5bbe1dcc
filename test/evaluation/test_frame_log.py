from __future__ import annotations

import csv

import numpy as np
import pytest

from radcam_depth_ros.drive import Sample
from radcam_depth_ros.evaluation.drive import Drive, FrameMeasures, Observation
from radcam_depth_ros.evaluation.frames import FrameLog
from radcam_depth_ros.evaluation.measures.metrics import MEASURES
from radcam_depth_ros.files import FileError
from radcam_depth_ros.frame import CameraModel, DepthResult, Frame, RadarReturns

CAMERA = CameraModel(4, 3, 10.0, 10.0, 1.5, 1.0)


def observe(index, mae_m, bag="a", scenario=None):
    depth = np.full((3, 4), 20.0, np.float32)
    frame = Frame(index * 10**9, "camera", np.zeros((3, 4, 3), np.uint8), CAMERA, RadarReturns.empty())
    result = DepthResult(index, "camera", CAMERA, depth, depth, depth, 0)
    measures = FrameMeasures(np.full((3, 8), mae_m), {"ground_nearest": np.full((3, 8), 9.0)}, 0.25, 1.5, 12, 0.05)
    return Observation(Drive([], bag, scenario or {}), index, Sample(frame, (), depth, "exact"), result, {}, measures)


def test_each_frame_is_a_line(tmp_path):
    log = FrameLog()
    log.add(observe(0, 1.25, "a, b", {"weather": "rain"}))
    log.add(observe(1, np.nan))
    log.write_csv(tmp_path / "new" / "frames.csv")
    with (tmp_path / "new" / "frames.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["bag"] for row in rows] == ["a, b", "a"]
    assert [row["frame"] for row in rows] == ["0", "1"]
    assert [row["weather"] for row in rows] == ["rain", ""]
    assert rows[1]["stamp_ns"] == "1000000000"
    assert rows[0]["returns_in_view"] == "12"
    assert rows[0]["latency_ms"] == "50.0"
    for measure in MEASURES:
        for name in ("50", "70", "80"):
            assert float(rows[0][f"{measure}_{name}"]) == 1.25
            assert rows[1][f"{measure}_{name}"] == ""
    assert (rows[0]["semi_dense_coverage"], rows[0]["semi_dense_mae_80"]) == ("0.25", "1.5")
    assert (rows[0]["ground_nearest_mae_80"], rows[0]["ground_nearest_rmse_80"]) == ("9", "9")


def test_without_frames_there_is_a_heading(tmp_path):
    FrameLog().write_csv(tmp_path / "frames.csv")
    assert (tmp_path / "frames.csv").read_text(encoding="utf-8").startswith("bag,frame,stamp_ns,ground_truth,weather,")


def test_the_worst_frames_come_first():
    log = FrameLog()
    for index in range(30):
        log.add(observe(index, float(index % 20), scenario={"weather": "fog"}))
    log.add(observe(30, np.nan))
    table = log.worst_table(3)
    assert table.columns == (
        *("bag and frame", "stamp s", "weather", "returns", "MAE m", "RMSE m", "MAE m, geometry alone"),
    )
    assert [row[0] for row in table.rows] == ["a 19", "a 18", "a 17"]
    assert table.rows[0][2:] == ("fog", "12", "19.00", "19.00", "9.00")
    assert FrameLog().worst_table().rows == ()


def test_a_file_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    with pytest.raises(FileError, match=r"cannot write .*taken"):
        FrameLog().write_csv(tmp_path / "taken" / "frames.csv")
