"""Before the first image the network is warmed up for its camera, as soon as camera_info is known."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.messages import MessageError
from radcam_depth_ros.node import watchdog

WIDE = CameraModel(2048, 618, 1260.0, 1260.0, 1023.5, 308.5)
WORKER = "radcam_depth"


def binned(bench: Any, camera: CameraModel, factor: int) -> Any:
    info = bench.camera_info(camera)
    info.binning_x = info.binning_y = factor
    return info


def test_each_camera_is_warmed_up_for_before_any_image(start: Callable[..., Any]) -> None:
    bench = start()
    bench.connect()

    def sizes() -> list[tuple[int, int]]:
        return [(camera.width, camera.height) for camera, thread in bench.fake.warmed_up if thread == WORKER]

    bench.send_until(sizes, lambda: bench.send("camera_info", bench.camera_info(WIDE)), what="the warm-up")
    assert sizes() == [(2048, 618)]
    bench.send_until(lambda: sizes()[1:], lambda: bench.send("camera_info", binned(bench, WIDE, 2)), what="another")
    assert sizes() == [(2048, 618), (1024, 309)]
    assert bench.fake.warmed_up[-1][0].fx == WIDE.fx / 2
    assert not bench.fake.stamps_ns
    bench.await_depth()


@pytest.mark.parametrize(("kind", "text"), [(MessageError, "expected fewer pixels, got many"), (ValueError, "odd")])
def test_a_camera_that_the_network_cannot_serve_is_told_before_any_image(
    start: Callable[..., Any], kind: type[Exception], text: str
) -> None:
    bench = start()
    bench.connect()
    warm_up = bench.fake.warm_up

    def fail(camera: CameraModel) -> None:
        raise kind(text)  # a new one: an error that outlives the test would keep the node, by its traceback

    bench.fake.warm_up = fail
    status = bench.send_until(
        lambda: bench.status("inference", text), lambda: bench.send("camera_info", bench.camera_info(WIDE))
    )
    assert status.level == b"\x02"
    bench.fake.warm_up = warm_up
    bench.await_depth()


def test_what_takes_long_is_told_and_is_no_missing_depth(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = start()
    bench.connect()
    may_go_on = threading.Event()
    bench.fake.warm_up = lambda camera: may_go_on.wait(60)
    try:
        status = bench.send_until(lambda: bench.status("inference", "warmed up"), what="its line")
        assert "96 x 64" in status.message
        monkeypatch.setattr(watchdog, "NO_OUTPUT_S", 0.2)
        told, received = len(bench.diagnostics), bench.node._session.rates["camera"].count
        # Callbacks go on: messages are taken, and diagnostics come.
        bench.send_until(
            lambda: len(bench.diagnostics) > told + 5 and bench.node._session.rates["camera"].count > received + 5
        )
        assert bench.diagnostics[-1]["output"].level == b"\x03"
        assert not [line for line in bench.logs if "no depth for" in line]
    finally:
        may_go_on.set()
    bench.await_depth()
