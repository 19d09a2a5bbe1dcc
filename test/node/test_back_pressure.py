"""A camera that is twice as fast as the network: the newest image is worked on, the rest is dropped and counted."""

from __future__ import annotations

import functools
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from radcam_depth_ros.frame import CameraModel

FRAMES = 200
NETWORK_S = 0.08
CAMERA = CameraModel(320, 240, 300.0, 300.0, 159.5, 119.5)


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def is_past(moment_s: float) -> bool:
    return time.monotonic() >= moment_s


def test_the_newest_image_is_worked_on_and_nothing_piles_up(
    start: Callable[..., Any], make_estimator: Callable[..., Any]
) -> None:
    bench = start(lambda config: make_estimator(config, seconds=NETWORK_S))
    bench.connect()
    bench.await_depth()
    session = bench.node._session
    behind: list[int] = []
    sent_ns: list[int] = []
    estimate = bench.fake.estimate

    def estimate_and_look(frame: Any) -> Any:
        behind.append(sum(stamp > frame.stamp_ns for stamp in sent_ns))
        return estimate(frame)

    bench.fake.estimate = estimate_and_look
    before_in, before_out, before_dropped = session.frames_in, session.frames_out.count, session.frames_dropped
    infos, memory, threads = bench.camera_info(CAMERA), [], threading.active_count()
    next_s = time.monotonic()
    for _ in range(FRAMES):
        bench.now_ns += 10_000_000
        sent_ns.append(bench.now_ns)
        bench.send_pair(image=bench.image(CAMERA), camera_info=infos)
        memory.append(resident_mib())
        next_s += NETWORK_S / 2
        bench.until(functools.partial(is_past, next_s))
    bench.until(lambda: session.busy_since_ns is None)

    frames_in, dropped = session.frames_in - before_in, session.frames_dropped - before_dropped
    frames_out = session.frames_out.count - before_out
    assert frames_in >= 0.9 * FRAMES
    assert frames_out + dropped == frames_in
    assert dropped >= 0.3 * frames_in
    assert bench.fake.stamps_ns == sorted(bench.fake.stamps_ns)
    # One that was sent may still be under way when the network takes the newest that came.
    assert np.percentile(behind, 90) <= 1
    processing_ms, latency_ms = session.processing.percentiles_ms()[0], session.latency.percentiles_ms()
    assert latency_ms[1] < 2.5 * processing_ms, (latency_ms, processing_ms)
    assert threading.active_count() == threads
    assert memory[-1] - memory[FRAMES // 4] < 8, memory

    bench.diagnostics.clear()
    status = bench.until(lambda: bench.status("inference", "from image to depth"))
    values = {value.key: value.value for value in status.values}
    assert values["dropped: overload"] == str(session.frames_dropped)
    assert values["frames out"] == str(session.frames_out.count)
    assert {"latency p50 [ms]", "latency p95 [ms]", "latency p99 [ms]"} <= values.keys()
