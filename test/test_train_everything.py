"""`scripts/train_everything.sh`, with the two minutes that it takes at least."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from radcam_depth_ros.networks.weights_io import archive

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "scripts" / "train_everything.sh"
IN_THE_BACKGROUND = ["bash", "-c", 'trap "" INT; exec "$@"', "-"]
"""As a script starts what it does not wait for: SIGINT is ignored."""


@pytest.mark.endurance
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("beside", ["", "1"])
def test_two_minutes_give_weights_and_their_errors(beside: str, tmp_path: Path) -> None:
    out = tmp_path / "everything"
    environment = {**os.environ, "BESIDE": beside}
    subprocess.run([*IN_THE_BACKGROUND, str(SCRIPT), "2", str(out)], check=True, cwd=ROOT, env=environment)
    trained = archive.load(out / "mix" / "baff.safetensors")
    assert trained.card.network == "baff"
    errors = json.loads((out / "errors.json").read_text(encoding="utf-8"))
    assert errors["frames"] == 8
    assert errors["dense"]["80"]["mae"] > 0
    assert (out / "drives.log").exists() == bool(beside)
    # Started again it has nothing left to do but to measure.
    before = {path: path.stat().st_mtime_ns for path in (out / "mix").iterdir()}
    subprocess.run([str(SCRIPT), "2", str(out)], check=True, cwd=ROOT, env=environment)
    assert {path: path.stat().st_mtime_ns for path in (out / "mix").iterdir()} == before


@pytest.mark.parametrize("minutes", ["1", "two", "-3"])
def test_too_few_minutes_are_refused(minutes: str, tmp_path: Path) -> None:
    run = subprocess.run([str(SCRIPT), minutes, str(tmp_path / "out")], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert f"expected a whole number of minutes from 2 on, got '{minutes}'" in run.stderr
    assert not (tmp_path / "out").exists()
