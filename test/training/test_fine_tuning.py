"""Fine-tuning on a LiDAR's scans, which never see the sky, keeps the sky and the calibration of the confidence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from radcam_depth_ros.cli import app

RECIPE = {
    "phases": [{"share": 1.0, "crops": [[320, 256]], "batch": 4}],
    "optimiser": {"learning_rate": 6.0e-4, "part_rates": {"encoder": 0.5}, "average_decay": 0.9},
    "validation": {"every_iterations": 40, "frames": 8},
    "freeze_statistics": True,
}


def invoke(*arguments: object) -> None:
    """Runs `radcam-depth`; what it raises is raised."""
    assert CliRunner().invoke(app, [str(word) for word in arguments], catch_exceptions=False).exit_code == 0


@pytest.mark.exhaustive
@pytest.mark.timeout(1800)
def test_the_sky_and_the_calibration_are_kept(tmp_path: Path) -> None:
    still = tmp_path / "still.yaml"
    still.write_text(yaml.safe_dump({"key_frames": True, "camera": {"rate_hz": 1.0}, "lidar": {"enabled": False}}))
    scanned = tmp_path / "scanned.yaml"
    scanned.write_text(yaml.safe_dump({"lidar": {"enabled": True}}))
    invoke("simulate", tmp_path / "new", "--seed", 20, "--drives", 2, "--frames", 6, "--config", scanned)
    invoke("simulate", tmp_path / "known", "--seed", 30, "--drives", 2, "--frames", 4, "--config", still)
    invoke("simulate", tmp_path / "measured", "--seed", 40, "--drives", 3, "--frames", 3, "--config", still)

    def measured(model: object) -> dict[str, Any]:
        file = tmp_path / "measured.json"
        invoke("evaluate", tmp_path / "measured", "--model", model, "--json", file)
        found: dict[str, Any] = json.loads(file.read_text())
        return found

    before = measured("baff")
    for share, rehearsed in ((0.0, ()), (0.5, ("--rehearsal-bags", tmp_path / "known"))):
        recipe, run = tmp_path / "recipe.yaml", tmp_path / f"run{share}"
        recipe.write_text(yaml.safe_dump({**RECIPE, "rehearsal": {"share": share}}))
        invoke(
            *("train", "--init", "baff", "--bags", tmp_path / "new", "--ground-truth", "lidar", *rehearsed),
            *("--config", recipe, "--iterations", 40, "--out", run),
        )
        after = measured(run / "baff.safetensors")
        assert after["sky"]["finite"] <= before["sky"]["finite"] + 0.02
        assert after["sky"]["kept"] >= before["sky"]["kept"] - 0.01
        assert after["confidence"]["ece"] <= before["confidence"]["ece"] + 0.03
