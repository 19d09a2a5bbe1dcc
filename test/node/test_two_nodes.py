"""Two nodes in one process: what happens to one is nothing to the other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from analyzers import grouped

from radcam_depth_ros.encoder import OUTPUTS

CONFIG = Path(__file__).parents[2] / "config"
PARTS = ("health", "camera", "radar", "calibration", "pairing", "inference", "output", "model")
SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("is_shared", [True, False], ids=["one executor", "two executors"])
def test_a_node_that_is_deactivated_or_destroyed_leaves_the_other_alive(
    start: Callable[..., Any], is_shared: bool
) -> None:
    front = start(namespace="front")
    left = start(namespace="left", beside=front if is_shared else None)
    left.now_ns = 5_000 * SECOND_NS
    front.connect()
    front.await_depth()
    left.until(lambda: left.node.count_publishers("/front/depth/camera_info"), what="the outputs of the other node")
    left.diagnostics.clear()
    told = left.until(lambda: left.status("calibration", "nobody publishes it; of this type there is"))
    assert "there is /front/camera_info:" in told.message
    sentences = [status.message for diagnostics in left.diagnostics for status in diagnostics.values()]
    assert not [text for text in sentences if any(f"/front/{output.topic}" in text for output in OUTPUTS.values())]
    left.connect()
    left.await_depth()
    check_aggregated(front, left)
    assert left.change_state("deactivate")
    front.await_depth()
    assert (front.state, left.state) == ("active", "inactive")
    left.until(lambda: left.status("camera", "the node is inactive"))
    assert not front.status("camera", "the node is inactive")
    assert left.change_state("activate")
    left.connect()
    left.await_depth()
    front.await_depth()
    # Each has the depth of its own camera alone.
    assert {message.header.stamp.sec >= 5_000 for message in front.depth} == {False}
    assert {message.header.stamp.sec >= 5_000 for message in left.depth} == {True}
    left.close()
    front.await_depth()
    assert front.state == "active"


def check_aggregated(front: Any, left: Any) -> None:
    """Neither node's statuses hide the other's in an aggregator."""
    names = [status.name for bench in (front, left) for status in bench.diagnostics[-1].values()]
    assert len(set(names)) == len(names) == 2 * len(PARTS)
    found = grouped(CONFIG / "analyzers_two_cameras.yaml", (*names, "/front/camera: status", "/other: status"))
    assert found.keys() == {"/Vehicle/Depth/Front", "/Vehicle/Depth/Left"}
    for shown in found.values():
        assert tuple(name.split()[0] for name in shown) == PARTS
    (shown,) = grouped(CONFIG / "analyzers.yaml", (*names, "/front/camera: status")).values()
    assert len(set(shown)) == 2 * len(PARTS)
