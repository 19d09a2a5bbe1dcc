"""The one training loop takes every network."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
from small_training import CONFIG, Watch, data_of

from radcam_depth_ros import networks
from radcam_depth_ros.networks.weights_io import archive
from radcam_depth_ros.training.curves import read_metrics
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.fit import Trainer
from radcam_depth_ros.training.initial import Sources
from radcam_depth_ros.training.recipe import PhaseConfig

ONCE = dataclasses.replace(CONFIG, iterations=1, log_every_iterations=1, phases=(PhaseConfig(1.0, ((64, 64),), 2),))
SMALL: dict[str, dict[str, object]] = {
    "baff": {"channels": [8, 8, 8, 8]},
    "baseline": {"channels": [8, 8, 8, 8]},
    "baff_paper": {"region_width_px": 32, "radar_map_size": [2, 1]},
    # oneDNN writes beyond its buffers in strided convolutions of fewer than 8 channels, on processors with AVX2 alone.
    "structured": {"joined_channels": 16, "radar_channels": [8, 8, 8, 8, 8]},
}


def train(name: str, drive: CachedDrive, folder: Path, sources: Sources | None = None) -> dict[str, object]:
    """One iteration; the losses of it."""
    folder.mkdir()
    config = dataclasses.replace(ONCE, architecture=SMALL.get(name, {}))
    result = Trainer(name, data_of(drive), config, folder, Watch(), False, sources).run()
    assert result.finished
    assert result.archive is not None
    assert archive.load(result.archive).card.network == name
    return next(row for row in read_metrics(folder / "metrics.jsonl") if row["kind"] == "train")


@pytest.mark.usefixtures("number_format")
@pytest.mark.parametrize("name", networks.names())
def test_every_network_is_trained_by_its_name(name: str, drive: CachedDrive, tmp_path: Path) -> None:
    losses = train(name, drive, tmp_path / "run")
    assert all(math.isfinite(value) for value in losses.values() if isinstance(value, float))


@pytest.mark.usefixtures("number_format")
def test_a_student_is_taught(drive: CachedDrive, tmp_path: Path) -> None:
    train("lircdepth", drive, tmp_path / "teacher")
    teacher = str(tmp_path / "teacher" / "lircdepth.safetensors")
    losses = train("lircdepth", drive, tmp_path / "student", Sources(teacher=teacher))
    assert {"distilled_image", "distilled_radar", "distilled_decoder", "distilled_depth"} <= losses.keys()
