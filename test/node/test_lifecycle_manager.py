"""Two nodes under nav2's lifecycle manager: the services that it calls, in its order, with its time limits.

Of nav2_lifecycle_manager and LifecycleServiceClient (nav2_util), branches jazzy and kilted: a transition is asked for
by its number alone. The manager does not look at its success but at what get_state says right afterwards. It configures
one node after the other, then activates one after the other; the other transitions it makes in the reverse order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from radcam_depth_ros.estimator import Estimator

GOALS = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: State.PRIMARY_STATE_FINALIZED,
}
NODES = ("front/radcam_depth", "rear/radcam_depth")
SERVICE_S = 5.0
"""So long the manager waits for a service to appear."""


@dataclass(frozen=True)
class Limits:
    """Seconds within which an answer must come; None for as long as it takes."""

    transition_s: float | None
    state_s: float


LIMITS = {"jazzy": Limits(None, 2.0), "kilted": Limits(5.0, 5.0)}


class Manager:
    """The calls of the manager, by a peer that stands beside the nodes.

    Args:
        peer: Makes the calls.
        names: `node_names`, in their order.
        limits: Those of the manager's version.
    """

    def __init__(self, peer: Any, names: Sequence[str], limits: Limits) -> None:
        self._peer, self._names, self._limits = peer, names, limits
        self._clients = {
            name: (
                peer.peer.create_client(ChangeState, f"{name}/change_state"),
                peer.peer.create_client(GetState, f"{name}/get_state"),
            )
            for name in names
        }
        for _, get_state in self._clients.values():
            peer.until(get_state.service_is_ready, what=get_state.srv_name)

    def startup(self) -> bool:
        return self.change(Transition.TRANSITION_CONFIGURE) and self.resume()

    def resume(self) -> bool:
        return self.change(Transition.TRANSITION_ACTIVATE)

    def pause(self) -> bool:
        return self.change(Transition.TRANSITION_DEACTIVATE)

    def reset(self) -> bool:
        return self.pause() and self.change(Transition.TRANSITION_CLEANUP)

    def shutdown(self) -> bool:
        return self.reset() and self.change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)

    def change(self, transition: int) -> bool:
        """A transition of all nodes; ends with the first that is not where it should be."""
        is_upwards = transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
        names = self._names if is_upwards else reversed(self._names)
        return all(self._change_one(name, transition) for name in names)

    def _change_one(self, name: str, transition: int) -> bool:
        change_state, get_state = self._clients[name]
        self._call(change_state, ChangeState.Request(transition=Transition(id=transition)), self._limits.transition_s)
        answer = self._call(get_state, GetState.Request(), self._limits.state_s)
        return bool(answer.current_state.id == GOALS[transition])

    def _call(self, client: Any, request: Any, limit_s: float | None) -> Any:
        self._peer.until(client.service_is_ready, SERVICE_S, client.srv_name)
        future = client.call_async(request)
        limit = {} if limit_s is None else {"timeout_s": limit_s}
        self._peer.until(future.done, what=client.srv_name, **limit)
        return future.result()


@pytest.mark.parametrize("version", LIMITS)
def test_two_cameras_from_start_to_end(start: Callable[..., Any], peer: Any, version: str) -> None:
    front, rear = (start(namespace=camera, autostart=False) for camera in ("front", "rear"))
    manager = Manager(peer, NODES, LIMITS[version])
    assert manager.startup()
    for bench in (front, rear):
        bench.connect()
        bench.await_depth()
    assert manager.pause()
    assert (front.state, rear.state) == ("inactive", "inactive")
    assert manager.resume()
    for bench in (front, rear):
        bench.await_depth()
    assert manager.reset()
    assert manager.startup()
    for bench in (front, rear):
        bench.await_depth()
    assert manager.shutdown()
    assert (front.state, rear.state) == ("finalized", "finalized")


def test_a_node_that_works_is_paused_as_well(
    start: Callable[..., Any], make_estimator: Callable[..., Any], peer: Any
) -> None:
    bench = start(lambda config: make_estimator(config, seconds=0.5), namespace="front", autostart=False)
    manager = Manager(peer, NODES[:1], LIMITS["kilted"])
    assert manager.startup()
    bench.connect()
    bench.await_depth()
    bench.send_pair()
    assert manager.pause()
    assert manager.resume()
    bench.await_depth()


def test_a_start_that_fails_can_be_repeated(
    start: Callable[..., Any], make_estimator: Callable[..., Any], tmp_path: Path, peer: Any
) -> None:
    def make(config: Any) -> Any:
        return Estimator(config) if config.model_file else make_estimator(config)

    front = start(namespace="front", autostart=False)
    rear = start(make, namespace="rear", autostart=False, model_file=str(tmp_path / "nothing.safetensors"))
    manager = Manager(peer, NODES, LIMITS["jazzy"])
    assert not manager.startup()
    assert (front.state, rear.state) == ("inactive", "unconfigured")
    assert rear.set_parameter("model_file", "") == ""
    # What is configured already refuses, and is where it should be: the manager goes on.
    assert manager.startup()
    assert (front.state, rear.state) == ("active", "active")


def test_a_node_that_starts_by_itself_is_not_for_the_manager(start: Callable[..., Any], peer: Any) -> None:
    bench = start(namespace="front")
    bench.until(lambda: bench.state == "active")
    assert not Manager(peer, NODES[:1], LIMITS["jazzy"]).startup()
    assert bench.state == "active"
