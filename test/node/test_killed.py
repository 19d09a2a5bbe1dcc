"""Processes that are killed and cannot say so: the node, and who publishes the sensors."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from radcam_depth_ros.node import watchdog

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"
RADAR = "radar /radar/points"


def values(bench: Any, part: str) -> dict[str, str]:
    return {value.key: value.value for value in bench.diagnostics[-1][part].values}


def has_levels(bench: Any, **levels: bytes) -> Callable[[], bool]:
    wanted = {RADAR if part == "radar" else part: level for part, level in levels.items()}
    return lambda: (
        bool(bench.diagnostics) and all(bench.diagnostics[-1][part].level == level for part, level in wanted.items())
    )


def stamps_ns(bench: Any) -> list[int]:
    stamps = [message.header.stamp for message in bench.depth]
    return [stamp.sec * 1_000_000_000 + stamp.nanosec for stamp in stamps]


def test_a_node_that_was_killed_and_runs_again_takes_up_what_still_comes(run: Callable[..., Any], peer: Any) -> None:
    killed = run("never")
    peer.connect()
    peer.send_until(lambda: peer.diagnostics and int(values(peer, "output").get("frames out", 0)) >= 5, what="depth")
    killed.kill()
    killed.wait()
    silent_s = time.monotonic() + 0.3
    peer.send_until(lambda: time.monotonic() > silent_s)  # nothing of the killed one is under way any more
    peer.depth.clear()
    peer.diagnostics.clear()
    before_ns = peer.now_ns

    run("never")
    peer.send_until(has_levels(peer, health=OK), what="health")
    sent = (peer.now_ns - before_ns) // 100_000_000
    assert 1 <= int(values(peer, "output")["images"]) <= sent
    assert values(peer, "camera")["publishers"] == "1"
    pairing = values(peer, "pairing")
    assert [pairing[name] for name in ("backward jumps", "duplicates", "out of order")] == ["0", "0", "0"]
    peer.await_depth()
    stamps = stamps_ns(peer)
    assert stamps == sorted(set(stamps))
    assert stamps[0] > before_ns


def test_sensors_whose_process_was_killed_are_named_until_another_one_publishes(
    start: Callable[..., Any],
    run_process: Callable[..., Any],
    write_drive: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(watchdog, "SILENCE_S", 0.5)
    monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.6)
    drive = write_drive(tmp_path / "drive.mcap", frames=50)
    play = ("-m", "radcam_depth_ros.cli", "play", str(drive), "--loop")
    bench = start(image_topic="/camera/image_raw", radar_fields="radial_speed= rcs=")  # the drive has none that varies
    killed = run_process(*play)
    # Three seconds of the drive: so long may another process take until it is heard.
    bench.until(lambda: len(bench.depth) >= 30, what="depth")
    bench.until(has_levels(bench, camera=OK, radar=OK, output=OK), what="health")
    killed.kill()
    killed.wait()
    bench.until(has_levels(bench, camera=ERROR, radar=WARN, output=ERROR, health=ERROR), what="what is missing")
    for part in ("camera", RADAR):
        assert "got nothing for" in bench.diagnostics[-1][part].message
    assert "sensor_msgs/msg/Image on /camera/image_raw" in bench.diagnostics[-1]["output"].message
    last_ns, jumps = stamps_ns(bench)[-1], int(values(bench, "pairing")["backward jumps"])

    bench.depth.clear()
    run_process(*play)
    bench.until(lambda: bench.depth, what="depth of the second process")
    assert stamps_ns(bench)[0] < last_ns  # the drive begins anew
    bench.until(has_levels(bench, camera=OK, radar=OK, output=OK), what="health")
    assert int(values(bench, "pairing")["backward jumps"]) > jumps
    bench.until(lambda: bench.logs and [line for line in bench.logs if "no depth for" in line])
