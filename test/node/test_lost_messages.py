"""Messages that were published and never came."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest


def test_images_that_are_lost_while_the_node_is_busy_are_counted(
    start: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = start()
    bench.connect()
    bench.await_depth()
    session = bench.node._session
    bench.until(lambda: session._publishers.get("camera") == 1, what="that there is one publisher")
    bench.send("image", bench.image())
    rate, lost = session.rates["camera"], session.lost["camera"]
    count = rate.count
    bench.send_until(lambda: rate.count > count, lambda: bench.send("image", bench.image()), what="an image")
    put, is_held = session.reader.put, threading.Event()

    def hold(*arguments: Any) -> Any:
        is_held.wait(60)
        return put(*arguments)

    monkeypatch.setattr(session.reader, "put", hold)
    before = rate.count + lost.count
    for _ in range(20):
        bench.now_ns += 100_000_000
        bench.send("image", bench.image())
    time.sleep(0.5)
    is_held.set()
    bench.until(lambda: rate.count + lost.count >= before + 20, what="all images, as messages or as losses")
    assert lost.count > 0
    shown = bench.until(
        lambda: (
            {value.key: value.value for value in bench.diagnostics[-1]["camera"].values}.get("lost before they came")
            == str(lost.count)
        ),
        what="the number in the diagnostics",
    )
    assert shown
