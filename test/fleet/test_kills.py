"""A run that SIGKILL ends and that starts again loses nothing, does nothing twice, and leaves nothing half-written."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from fleet.numbering import Numbering

from radcam_depth_ros.fleet.results import open_results
from radcam_depth_ros.fleet.running import run
from radcam_depth_ros.fleet.unit import units_of

ROOT = Path(__file__).parents[2]
DRIVES = 40


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.endurance)])
def test_kills_lose_nothing_and_repeat_nothing(tmp_path, kills):
    folder, out, log = tmp_path / "drives", tmp_path / "out", tmp_path / "log"
    folder.mkdir()
    for index in range(DRIVES):
        (folder / f"{index:02}.mcap").write_bytes(b"x" * (index + 1))
    command = [sys.executable, str(Path(__file__).with_name("counting_run.py")), folder, out, log, "0.03"]
    generator, finished = np.random.default_rng(kills), set[str]()
    for _ in range(kills):
        process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=tmp_path)
        more = len(finished) + int(generator.integers(0, 3))
        deadline = time.monotonic() + 60
        while process.poll() is None and len(results(out)) < more and time.monotonic() < deadline:
            time.sleep(0.001)
        time.sleep(float(generator.uniform(0, 0.05)))
        process.kill()
        process.wait()
        there = results(out)
        assert finished <= there, "a finished drive was lost"
        finished = there
        for path in (out / "drives").glob("*"):
            if not path.name.startswith("."):
                assert gzip.decompress(path.read_bytes()).count(b"\n") == 2
    before = Counter(log.read_text(encoding="utf-8").split()) if log.exists() else Counter()
    units = units_of([str(path) for path in sorted(folder.iterdir())])
    summary = run(Numbering(str(log)), units, str(out))
    assert summary.kept == len(finished)
    after = Counter(log.read_text(encoding="utf-8").split())
    # A drive is begun again only where a kill came before its result was there.
    assert all(after[name] == before[name] for name in finished)
    assert sum(after.values()) <= DRIVES + kills
    found = open_results(str(out))
    assert [found.result(unit)["value"] for unit in units] == list(range(1, DRIVES + 1))
    assert len(results(out)) == DRIVES


def results(out: Path) -> set[str]:
    return {path.name.split(".")[0] for path in (out / "drives").glob("[0-9]*.json.gz")}
