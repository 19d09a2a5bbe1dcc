from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import contention
from radcam_depth_ros.frame import RadcamDepthError

ROOT = Path(__file__).parents[2]
KEYS = {"size", "cores", "threads", "GOMP_SPINCOUNT", "OMP_WAIT_POLICY", "engine", "node"}
ENGINE_KEYS = {"busy", "frames", "median_ms", "p99_ms", "median_ratio", "p99_ratio"}
NODE_KEYS = {"busy", "frames_per_s", "median_ms", "p99_ms", "node_cpu", "median_ratio", "p99_ratio"}


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the benchmark sets for the processes that it starts is taken back."""
    for name in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """The processes that were started; they sleep in place of computing."""
    processes: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def noted(command: list[str]) -> subprocess.Popen[bytes]:
        if len(processes) == 3:
            raise OSError("no more processes")
        processes.append(start(command))
        return processes[-1]

    monkeypatch.setattr(contention, "BUSY_LOOP", "import time; time.sleep(600)")
    monkeypatch.setattr(contention, "SETTLE_S", 0.0)
    monkeypatch.setattr(contention.subprocess, "Popen", noted)
    return processes


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """What was asked to be measured; figures are made up: 50 ms, and 40 ms more for each busy process."""
    asked: list[tuple[object, ...]] = []

    def engine(size: tuple[int, int], load: int, frames: int, threads: int) -> contention.Figures:
        asked.append(("engine", size, load, frames, threads))
        return {"busy": load, "frames": frames, "median_ms": 50.0 + 40 * load, "p99_ms": 80.0 + 20 * load}

    def node(size: tuple[int, int], load: int, seconds: float, threads: int) -> contention.Figures:
        asked.append(("node", size, load, seconds, threads))
        # With four, no depth came.
        times = {"median_ms": None if load == 4 else 12345.6, "p99_ms": None if load == 4 else 23456.7}
        return {"busy": load, "frames_per_s": 0.0 if load == 4 else 11.25, **times, "node_cpu": 1.98}

    monkeypatch.setattr(contention, "measure_engine", engine)
    monkeypatch.setattr(contention, "measure_node", node)
    return asked


def test_busy_processes_last_as_long_as_the_measurement(started: list[subprocess.Popen[bytes]]) -> None:
    with contention.busy(2):
        assert [process.poll() for process in started] == [None, None]
    assert None not in [process.poll() for process in started]


def test_busy_processes_are_gone_after_an_error(started: list[subprocess.Popen[bytes]]) -> None:
    with pytest.raises(RuntimeError, match="no memory"), contention.busy(2):
        raise RuntimeError("no memory")
    assert len(started) == 2
    assert None not in [process.poll() for process in started]


def test_busy_processes_are_gone_when_one_cannot_start(started: list[subprocess.Popen[bytes]]) -> None:
    with pytest.raises(OSError, match="no more processes"), contention.busy(4):
        pass
    assert len(started) == 3
    assert None not in [process.poll() for process in started]


def test_ratios_are_to_the_first_row() -> None:
    rows = [
        {"busy": 1, "median_ms": 60.0, "p99_ms": None},
        {"busy": 2, "median_ms": 90.0, "p99_ms": 300.0},
        {"busy": 4, "median_ms": None, "p99_ms": 400.0},
    ]
    ratios = [(row["median_ratio"], row["p99_ratio"]) for row in contention.with_ratios(rows)]
    assert ratios == [(1.0, None), (1.5, None), (None, None)]
    assert contention.with_ratios([]) == []


def test_every_load_is_measured_in_both_and_written(
    measured: list[tuple[object, ...]], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--size", "96x128", "--busy", "0", "2", "--frames", "7", "--seconds", "3", "--threads", "1"]
    assert contention.main([*arguments, "--json", "-"]) == 0
    assert measured == [
        ("engine", (96, 128), 0, 7, 1),
        ("engine", (96, 128), 2, 7, 1),
        ("node", (96, 128), 0, 3.0, 1),
        ("node", (96, 128), 2, 3.0, 1),
    ]
    values = json.loads(capsys.readouterr().out)
    assert values.keys() == KEYS
    assert (values["size"], values["threads"], values["OMP_WAIT_POLICY"]) == ("96x128", 1, "")
    assert int(values["GOMP_SPINCOUNT"]) > 0
    assert [row.keys() for row in values["engine"]] == [ENGINE_KEYS] * 2
    assert [row.keys() for row in values["node"]] == [NODE_KEYS] * 2
    assert [(row["median_ratio"], row["p99_ratio"]) for row in values["engine"]] == [(1.0, 1.0), (2.6, 1.5)]


def test_its_tables_can_be_read_at_80_columns(
    measured: list[tuple[object, ...]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert contention.main(["--json", str(tmp_path / "figures.json")]) == 0
    output = capsys.readouterr().out
    assert max(map(len, output.splitlines())) <= 80
    assert "…" not in output
    for value in ("engine", "live node", "210.0", "4.2", "12345.6", "11.25", "1.98"):
        assert value in output
    assert json.loads((tmp_path / "figures.json").read_text(encoding="utf-8")).keys() == KEYS
    assert len(measured) == 8


def test_without_seconds_the_live_node_is_left_out(
    measured: list[tuple[object, ...]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert contention.main(["--seconds", "0", "--busy", "0"]) == 0
    assert [name for name, *_ in measured] == ["engine"]
    assert "live node" not in capsys.readouterr().out


def test_a_node_without_depth_is_one_sentence(
    measured: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*args: object, **options: object) -> None:
        raise RadcamDepthError("expected depth from the node, got none")

    monkeypatch.setattr(contention, "measure_node", fail)
    assert contention.main(["--busy", "0"]) == 1
    assert capsys.readouterr().err == "contention: expected depth from the node, got none\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "448"], "HEIGHTxWIDTH.*got '448'"),
        (["--size", "100x64"], "multiples of 32.*got '100x64'"),
        (["--busy", "-1"], "--busy"),
        (["--frames", "0"], "at least 1, got '0'"),
    ],
)
def test_bad_arguments(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        contention.main(arguments)
    errors = capsys.readouterr().err
    assert re.search(message, errors), errors


@pytest.mark.exhaustive
@pytest.mark.timeout(240)
def test_it_measures_an_engine_and_prints_json_alone(tmp_path: Path) -> None:
    options = ["--size", "64x96", "--frames", "3", "--seconds", "0", "--busy", "0", "1", "--json", "-"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.contention", *options],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    assert values.keys() == KEYS
    assert [(row["busy"], row["frames"]) for row in values["engine"]] == [(0, 3), (1, 3)]
    assert all(0 < row["median_ms"] <= row["p99_ms"] for row in values["engine"])
    assert values["node"] == []
