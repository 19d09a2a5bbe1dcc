"""Transitions in any order, those that fail and those that are not allowed among them: nothing is left behind."""

from __future__ import annotations

import contextlib
import gc
import random
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import resident
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from radcam_depth_ros.estimator import Estimator, EstimatorConfig
from radcam_depth_ros.node.depth_node import RadcamDepthNode

try:
    from rclpy._rclpy_pybind11 import RCLError
except ImportError:
    pytest.skip("rclpy is of another kind", allow_module_level=True)

ROUNDS, WARM_UP_ROUNDS = 200, 40
MAX_GROWTH_MIB = 2.0
FILES, PATIENCE_S = Path("/proc/self/fd"), 5.0
TARGETS = {
    ("unconfigured", "configure"): "inactive",
    ("inactive", "cleanup"): "unconfigured",
    ("inactive", "activate"): "active",
    ("active", "deactivate"): "inactive",
    **{(state, "shutdown"): "finalized" for state in ("unconfigured", "inactive", "active")},
}
NEED_WEIGHTS = ("configure", "activate")


@pytest.fixture
def make(
    context: Context, make_estimator: Callable[..., Any], extrinsics: list[float]
) -> Iterator[Callable[[], RadcamDepthNode]]:
    """Makes nodes that are driven by hand; with a `model_file` they load weights for real."""
    nodes = []

    def estimator(config: EstimatorConfig) -> Any:
        return Estimator(config) if config.model_file else make_estimator(config)

    def make() -> RadcamDepthNode:
        given = {"camera_from_radar": extrinsics, "autostart": False}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        nodes.append(RadcamDepthNode(estimator, context=context, parameter_overrides=overrides))
        return nodes[-1]

    # What is there already need not be looked at each time that the node gives back memory.
    gc.collect()
    gc.freeze()
    yield make
    gc.unfreeze()
    while nodes:
        nodes.pop().destroy_node()
    gc.collect()


def state_of(node: Any) -> str:
    return str(node._state_machine.current_state[1])


def belongings(node: Any) -> dict[str, int]:
    """How many of each there are: what ROS holds of the node, and the threads of the process."""
    kinds = ("subscriptions", "publishers", "timers", "services", "clients", "guards", "waitables")
    found = {kind: len(list(getattr(node, kind))) for kind in kinds}
    return {**found, "managed": len(node._managed_entities), "threads": threading.active_count()}


def open_files() -> dict[str, str]:
    """Descriptors of the process, that of this listing among them, and what each is; "" if it is closed by then."""
    found = {}
    for path in FILES.iterdir():
        found[path.name] = ""
        with contextlib.suppress(FileNotFoundError):
            found[path.name] = str(path.readlink())
    return found


def assert_no_more_files(before: dict[str, str]) -> None:
    """Other threads of the process may open a file for a moment: what stays open counts, and the failure names it."""
    end = time.monotonic() + PATIENCE_S
    while len(list(FILES.iterdir())) > len(before):
        now = open_files()
        assert time.monotonic() < end, {file: what for file, what in now.items() if before.get(file) != what}
        time.sleep(0.05)


def go(node: Any, label: str, weights: str = "") -> str:
    """Asks for a transition, with weights or those that are missing; returns the state that it leads to."""
    before = state_of(node)
    target = TARGETS.get((before, label))
    if target is None:
        with pytest.raises(RCLError):
            getattr(node, f"trigger_{label}")()
        target = before
    else:
        fails = bool(weights) and label in NEED_WEIGHTS
        if fails:
            (answer,) = node.set_parameters([Parameter("model_file", value=weights)])
            assert answer.successful
        result = getattr(node, f"trigger_{label}")()
        assert result is (TransitionCallbackReturn.FAILURE if fails else TransitionCallbackReturn.SUCCESS)
        if fails:
            target = before
            node.set_parameters([Parameter("model_file", value="")])
    assert state_of(node) == target
    return target


def test_two_hundred_rounds_in_any_order_leave_nothing_behind(make: Callable[[], Any], tmp_path: Path) -> None:
    node, rng = make(), random.Random(4)
    missing = str(tmp_path / "nothing.safetensors")
    labels = ("configure", "activate", "deactivate", "cleanup")
    known: dict[str, dict[str, int]] = {}
    files: dict[str, dict[str, str]] = {}
    visits: set[tuple[str, str, bool]] = set()
    warm_mib = 0.0
    for number in range(ROUNDS):
        for label in rng.sample(labels, len(labels)):
            weights = missing if rng.random() < 0.2 else ""
            visits.add((state_of(node), label, bool(weights)))
            state, found = go(node, label, weights), belongings(node)
            assert known.setdefault(state, found) == found, (number, label, state)
            # The fewest, so that what was open for a moment at first hides nothing that is left behind later.
            if state not in files or len(list(FILES.iterdir())) < len(files[state]):
                files[state] = open_files()
            assert_no_more_files(files[state])
        if number == WARM_UP_ROUNDS:
            warm_mib = resident.resident_mib()
    assert len(visits) == 3 * len(labels) * 2
    growth_mib = resident.resident_mib() - warm_mib
    assert growth_mib < MAX_GROWTH_MIB


@pytest.mark.parametrize("way", [[], ["configure"], ["configure", "activate"]], ids=lambda way: len(way))
def test_a_node_is_shut_down_from_any_state_once(make: Callable[[], Any], way: list[str]) -> None:
    node = make()
    before, files = belongings(node), open_files()
    for label in way:
        go(node, label)
    assert go(node, "shutdown") == "finalized"
    assert belongings(node) == before
    assert_no_more_files(files)
    for label in ("configure", "activate", "deactivate", "cleanup", "shutdown"):
        assert go(node, label) == "finalized"
