from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from radcam_depth_ros import openmp

ROOT = Path(__file__).parents[1]
NAMES = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")

WATCH = """
import importlib.abc, os, sys

class Watch(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            print("torch is imported with", os.environ.get("GOMP_SPINCOUNT"), flush=True)
            os._exit(3)

sys.meta_path.insert(0, Watch())
"""
STARTS = {
    "verb": "from radcam_depth_ros.cli import main; sys.argv = ['radcam-depth', 'networks']; main()",
    "node": "from radcam_depth_ros.node import main; main([])",
}


@pytest.fixture(autouse=True)
def _unset(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        # Set first, so that what `prepare` sets is taken back.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


def test_it_sets_the_spin_count() -> None:
    openmp.prepare()
    assert os.environ["GOMP_SPINCOUNT"] == openmp.SPIN_COUNT
    assert "OMP_WAIT_POLICY" not in os.environ


@pytest.mark.parametrize(("name", "value"), [("GOMP_SPINCOUNT", "0"), ("OMP_WAIT_POLICY", "PASSIVE")])
def test_what_the_user_has_set_stays(name: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, value)
    openmp.prepare()
    assert {given: os.environ.get(given) for given in NAMES} == {**dict.fromkeys(NAMES), name: value}


@pytest.mark.parametrize("given", [None, "77"])
@pytest.mark.parametrize("start", STARTS)
def test_it_is_set_before_torch_is_loaded(start: str, given: str | None) -> None:
    if start == "node":
        pytest.importorskip("rclpy")
    done = subprocess.run(
        [sys.executable, "-c", WATCH + STARTS[start]],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": _path(), **({"GOMP_SPINCOUNT": given} if given else {})},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.stdout.splitlines() == [f"torch is imported with {given or openmp.SPIN_COUNT}"], done.stderr
    assert done.returncode == 3


def _path() -> str:
    return os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
