"""Full, read-only and vanishing disks: one sentence, exit code 2, and nothing half-written."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command_line import run_main
from disks import full_disk

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("verb", "out", "options"),
    [
        ("export", "baff.pt", ()),
        ("replay", "out.mcap", ()),
        ("replay", "out", ()),
        ("view", "out.mp4", ("--save",)),
        ("view", "out.rrd", ("--save",)),
        ("view", "out.png", ("--save",)),
        ("view", "pictures", ("--save",)),
        ("evaluate", "out.json", ("--no-baselines", "--json")),
        ("evaluate", "out.html", ("--no-baselines", "--report")),
    ],
)
def test_a_full_disk(
    verb: str,
    out: str,
    options: tuple[str, ...],
    tmp_path: Path,
    write_drive: Callable[..., Path],
    small_weights: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if out.endswith(".rrd"):
        pytest.importorskip("rerun", reason="the extra `view` is not installed")
    drive = write_drive(tmp_path / "drive.mcap", frames=3)
    place = tmp_path / "outputs"
    place.mkdir()
    reads = [] if verb == "export" else [drive]
    with full_disk(500):
        assert run_main(monkeypatch, verb, *reads, *options, place / out, "--model", small_weights) == 2
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert out in "".join(told.split())
    assert list(place.iterdir()) == []


def test_a_read_only_disk(
    tmp_path: Path,
    write_drive: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=3)
    place = tmp_path / "read_only"
    place.mkdir()
    opened = os.open

    def refuse(path: Any, flags: int, *others: Any, **named: Any) -> int:
        if str(path).startswith(str(place)) and flags & os.O_CREAT:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return opened(path, flags, *others, **named)

    monkeypatch.setattr(os, "open", refuse)
    for arguments in (
        ["inspect", drive, "--write-params", place / "p.yaml"],
        ["inspect", drive, "--json", place / "i"],
    ):
        assert run_main(monkeypatch, *arguments) == 2
        assert "Read-only file system" in " ".join(capsys.readouterr().err.split())


def test_what_is_half_written_goes_after_sigterm(tmp_path: Path, write_drive: Callable[..., Path]) -> None:
    drive = write_drive(tmp_path / "drive.mcap", frames=200)
    place = tmp_path / "outputs"
    place.mkdir()
    command = [sys.executable, "-m", "radcam_depth_ros.cli", "replay", str(drive), str(place / "out.mcap")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 120
        while not any(place.iterdir()) and process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, told = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 128 + signal.SIGTERM, told
    assert "Traceback" not in told
    assert list(place.iterdir()) == []
