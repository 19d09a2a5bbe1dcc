from __future__ import annotations

from pathlib import Path

from benchmarks.streaming import measure, write_drives
from radcam_depth_ros.frame import CameraModel


def test_many_drives_are_read_with_few_files_and_little_memory(tmp_path: Path) -> None:
    write_drives(tmp_path / "drives", 2_000, CameraModel(352, 320, 630.0, 630.0, 176.0, 160.0), returns=50)
    figures = measure(tmp_path / "drives", 4)
    assert (figures.samples, figures.read) == (2_000, 16)
    assert figures.open_files < 200
    assert figures.own_mib < 2_000
