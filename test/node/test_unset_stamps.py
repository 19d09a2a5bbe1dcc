"""Radars whose driver sets no stamps, and radars that all have one frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

RADAR = "radar /radar/points"


def send_without_stamp(bench: Any) -> None:
    """An image that is stamped now, and a cloud with a stamp of 0."""
    bench.now_ns = time.time_ns()
    cloud = bench.cloud()
    cloud.header.stamp.sec = cloud.header.stamp.nanosec = 0
    bench.send_pair(cloud=cloud)


def test_a_stamp_of_0_is_named_with_what_helps(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()
    status = bench.send_until(
        lambda: bench.status(RADAR, "a stamp of 0"), lambda: send_without_stamp(bench), what="the stamp"
    )
    assert "set radar_stamps: arrival" in status.message
    assert status.level == b"\x01"
    bench.until(lambda: any("a stamp of 0" in line for line in bench.logs), what="the log")
    # No offset is proposed that its own range would refuse.
    assert not [line for line in bench.logs if "radar_time_offset_s" in line]


@pytest.mark.parametrize("is_listed", [False, True])
def test_by_arrival_such_a_radar_gives_depth_to_every_image(start: Callable[..., Any], is_listed: bool) -> None:
    # A wait that a busy machine keeps as well: a sweep comes with its image.
    bench = start(radar_stamps=["arrival"] if is_listed else "arrival", max_time_offset_s=10.0, max_wait_s=1.0)
    bench.connect()
    bench.send_until(lambda: len(bench.depth) >= 10, lambda: send_without_stamp(bench), what="depth")
    assert bench.fake.radar_m.keys() == {*bench.fake.stamps_ns}
    assert all(len(returns) == 2 for stamp, returns in sorted(bench.fake.radar_m.items())[1:])
    status = bench.diagnostics[-1][RADAR]
    assert {value.key: value.value for value in status.values}["stamps"] == "arrival"
    assert not [line for line in bench.logs if "a stamp of 0" in line]
