from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from benchmarks import node_rate

ROOT = Path(__file__).parents[2]


@pytest.mark.exhaustive
@pytest.mark.timeout(240)
def test_the_live_node_is_fed_and_measured(small_weights: Path, tmp_path: Path) -> None:
    options = ["--size", "32x64", "--seconds", "1", "--points", "3", "--parameter", f"model_file:={small_weights}"]
    # A domain that no other test uses.
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "ROS_DOMAIN_ID": str(int(os.environ["ROS_DOMAIN_ID"]) + 4)}
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.node_rate", *options, "--json", "-"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    values = json.loads(done.stdout)
    (row,) = values["sizes"]
    assert (values["points"], row["height"], row["width"]) == (3, 32, 64)
    assert 0 < row["received"] <= row["sent"]
    assert row["received"] + row["dropped"] == row["sent"]
    assert row["frames_per_s"] == pytest.approx(row["received"] / row["seconds"], rel=0.02)
    assert row["latency_ms"]["median"] <= row["latency_ms"]["p99"]
    assert row["node_cpu"] > 0


def test_no_depth_at_all_has_no_latency() -> None:
    values = node_rate.Rate(32, 64, 2.0, 3, (), 0.0, 0.0).as_json()
    assert values["latency_ms"] == {"median": None, "p90": None, "p99": None}
    assert (values["frames_per_s"], values["dropped"]) == (0.0, 3)


@pytest.mark.parametrize(("size", "focal_px"), [("448x800", 630.0), ("256x448", 630.0), ("900x1600", 1266.0)])
def test_each_size_is_seen_at_the_networks_focal_length(size: str, focal_px: float) -> None:
    camera = node_rate._camera(size)
    assert f"{camera.height}x{camera.width}" == size
    assert camera.fx == focal_px


def test_a_node_that_cannot_start_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert node_rate.main(["--size", "32x64", "--parameter", "network:=nonsense"]) == 1
    assert "nonsense" in capsys.readouterr().err


def test_its_table_can_be_read_at_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    sizes = [node_rate.Rate(height, 2048, 20.0, 12345, (1234.5, 45678.9), 1.98, 0.77) for height in (618, 1024, 1536)]
    node_rate.print_rates([size.as_json() for size in sizes])
    node_rate.print_rates([node_rate.Rate(448, 800, 20.0, 0, (), 0.0, 0.1).as_json()])
    output = capsys.readouterr().out
    assert max(map(len, output.splitlines())) <= 80
    assert "…" not in output
    for value in ("618 x 2048", "12345", "0.1", "23456.7", "45234.5", "41234.5", "12343", "1.98", "0.77"):
        assert value in output
    for column in ("frames/s", "median ms", "p90 ms", "p99 ms", "sent", "dropped", "node CPU", "feeder CPU"):
        assert column in output
