"""A camera that is twice as fast as the network: the newest image is worked on, the rest is dropped and counted."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from resident import resident_mib

from radcam_depth_ros.engine import give_back_memory
from radcam_depth_ros.frame import CameraModel

FRAMES = 200
NETWORK_S = 0.1
CAMERA = CameraModel(160, 120, 150.0, 150.0, 79.5, 59.5)


def in_use_mib() -> float:
    """What is held: what earlier tests freed is given back, else it would grow by being used again."""
    give_back_memory()
    return resident_mib()


def is_past(moment_s: float) -> bool:
    return time.monotonic() >= moment_s


@pytest.mark.alone
def test_the_newest_image_is_worked_on_and_nothing_piles_up(
    start: Callable[..., Any], make_estimator: Callable[..., Any]
) -> None:
    bench = start(lambda config: make_estimator(config, seconds=NETWORK_S))
    bench.connect()
    bench.await_depth(lambda: bench.send_pair(bench.image(CAMERA), camera_info=bench.camera_info(CAMERA)))
    session = bench.node._session

    def is_idle() -> bool:
        return bool(session.frames_in == session.frames_out.count + session.frames_dropped)

    bench.until(is_idle)
    behind: list[int] = []
    handed_ns: list[int] = []
    run, put = bench.fake.run, session._worker.put

    def put_and_note(ticket: Any) -> None:
        handed_ns.append(ticket.frame.stamp_ns)
        put(ticket)

    def run_and_look(inputs: Any) -> Any:
        behind.append(sum(stamp > inputs.frame.stamp_ns for stamp in handed_ns))
        return run(inputs)

    session._worker.put, bench.fake.run = put_and_note, run_and_look
    before_in, before_dropped = session.frames_in, session.frames_dropped
    image, cloud, threads = bench.image(CAMERA), bench.cloud(), threading.active_count()
    frames, quarter_mib, next_s = 0, 0.0, time.monotonic()
    while session.frames_in - before_in < FRAMES:
        frames += 1
        if frames == FRAMES // 4:
            quarter_mib = in_use_mib()
        bench.now_ns += 10_000_000
        for topic, message in (("radar/points", cloud), ("image", image)):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(bench.now_ns, 1_000_000_000)
            bench.send(topic, message)
        bench.depth.clear()
        next_s += NETWORK_S / 2
        bench.until(functools.partial(is_past, next_s))
    bench.until(is_idle)

    frames_in, dropped = session.frames_in - before_in, session.frames_dropped - before_dropped
    assert dropped >= 0.25 * frames_in
    assert bench.fake.stamps_ns == sorted(bench.fake.stamps_ns)
    # One may come between the moment when the worker takes the newest and that when it is looked at here.
    assert np.median(behind) == 0
    assert max(behind) <= 1
    latency_ms = session.latencies.percentiles_ms("latency")
    processing_ms = sum(session.latencies.percentiles_ms(part)[0] for part in ("inference", "encode"))
    assert latency_ms[1] < 2.5 * processing_ms, (latency_ms, processing_ms)
    assert threading.active_count() == threads
    assert in_use_mib() - quarter_mib < 5

    def told() -> dict[str, str]:
        parts = ("inference", "output")
        return {value.key: value.value for part in parts for value in bench.diagnostics[-1][part].values}

    bench.until(lambda: told()["dropped: overload"] == str(session.frames_dropped), what="the count of drops")
    bench.until(lambda: told()["frames out"] == str(session.frames_out.count), what="the count of frames")
    assert {"latency p50 [ms]", "latency p95 [ms]", "latency p99 [ms]"} <= told().keys()
