"""Two nodes in one process: what happens to one is nothing to the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("is_shared", [True, False], ids=["one executor", "two executors"])
def test_a_node_that_is_deactivated_or_destroyed_leaves_the_other_alive(
    start: Callable[..., Any], is_shared: bool
) -> None:
    front = start(namespace="front")
    rear = start(namespace="rear", beside=front if is_shared else None)
    rear.now_ns = 5_000 * SECOND_NS
    for bench in (front, rear):
        bench.connect()
        bench.await_depth()
    assert rear.change_state("deactivate")
    front.await_depth()
    assert (front.state, rear.state) == ("active", "inactive")
    rear.until(lambda: rear.status("camera", "the node is inactive"))
    assert not front.status("camera", "the node is inactive")
    assert rear.change_state("activate")
    rear.connect()
    rear.await_depth()
    front.await_depth()
    # Each has the depth of its own camera alone.
    assert {message.header.stamp.sec >= 5_000 for message in front.depth} == {False}
    assert {message.header.stamp.sec >= 5_000 for message in rear.depth} == {True}
    rear.close()
    front.await_depth()
    assert front.state == "active"
