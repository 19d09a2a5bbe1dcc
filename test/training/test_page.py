from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from small_training import Miniature, MiniatureConfig

from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.page import panels_of, plots_of, write_page
from radcam_depth_ros.training.precision import Precision

METRICS = [
    {"kind": "train", "step": 2, "total": 3.0, "learning_rate": 1e-3},
    {"kind": "train", "step": 4, "total": None, "learning_rate": 1e-3},
    {"kind": "validation", "step": 4, "mae_80_m": 2.0, "semi_dense_mae_m": None},
    {"kind": "rehearsal", "step": 4, "mae_80_m": 1.0},
]


def test_curves_are_those_that_there_are_values_for() -> None:
    plots = {plot.title: plot for plot in plots_of(METRICS)}
    assert set(plots) == {"Loss", "Error of the dense depth", "Learning rate"}
    assert plots["Loss"].curves[0].x == [2, 4]
    assert np.isnan(plots["Loss"].curves[0].y[1])
    assert [(curve.name, curve.is_dashed) for curve in plots["Error of the dense depth"].curves] == [
        ("MAE within 80 m", False),
        ("MAE within 80 m, rehearsed", True),
    ]
    assert plots_of([]) == ()


def test_a_page_holds_all_that_it_shows(tmp_path: Path, drive: CachedDrive) -> None:
    network = Miniature(MiniatureConfig()).eval()
    panels = panels_of(network, {"validation frame 0": drive[0]}, Precision.choose("float32", "cpu"))
    path = tmp_path / "report.html"
    write_page(path, "a run", [("network", "miniature")], METRICS, panels)
    text = path.read_text(encoding="utf-8")
    assert "validation frame 0, MAE within 80 m" in text
    assert "miniature" in text
    # Five pictures of a frame and three plots, nothing from elsewhere; links lead within the page.
    assert len(re.findall(r'<img [^>]*src="data:', text)) == 8
    assert not re.findall(r'(?:src|href)="(?!data:|#)', text)
