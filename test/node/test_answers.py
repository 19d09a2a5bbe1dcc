"""Every request to a service is answered once."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from resident import resident_mib

LABELS = ("configure", "activate", "deactivate", "cleanup")
AFTER = {
    ("unconfigured", "configure"): "inactive",
    ("inactive", "activate"): "active",
    ("inactive", "cleanup"): "unconfigured",
    ("active", "deactivate"): "inactive",
}
NO_TYPE = Parameter(name="max_wait_s", value=ParameterValue(type=99))


def race(bench: Any, requests: int, seed: int) -> list[tuple[str, bool]]:
    """Two clients that ask for transitions at random, each for the next one when it has its answer."""
    rng = random.Random(seed)
    clients = [bench.peer.create_client(ChangeState, "radcam_depth/change_state") for _ in range(2)]
    for client in clients:
        bench.until(client.service_is_ready, what="the service")
    waiting: dict[Any, tuple[str, Any]] = {}
    answers: list[tuple[str, bool]] = []

    def step() -> bool:
        for client in clients:
            if client in waiting and waiting[client][1].done():
                label, future = waiting.pop(client)
                answers.append((label, future.result().success))
            if client not in waiting and len(answers) + len(waiting) < requests:
                label = rng.choice(LABELS)
                waiting[client] = label, client.call_async(ChangeState.Request(transition=Transition(label=label)))
        return len(answers) == requests

    bench.until(step, what="all answers")
    for client in clients:
        bench.peer.destroy_client(client)
    return answers


@pytest.mark.parametrize("asked", [Transition(label="activate"), Transition(id=Transition.TRANSITION_ACTIVATE)])
def test_a_transition_that_is_not_possible_is_answered_and_told_in_one_sentence(
    start: Callable[..., Any], asked: Transition
) -> None:
    bench = start()
    bench.until(lambda: bench.state == "active")
    assert not bench._call(bench._transition, ChangeState.Request(transition=asked)).success
    assert bench.state == bench.node._phase == "active"
    what = repr(asked.label or asked.id)
    (line,) = bench.until(lambda: [line for line in bench.logs if "transition that is possible" in line])
    assert f"in the state active (deactivate, shutdown), got {what}; the state stays" in line
    bench.connect()
    bench.await_depth()


def test_every_request_of_two_clients_that_race_is_answered(start: Callable[..., Any]) -> None:
    bench = start()
    bench.until(lambda: bench.state == "active")
    answers = race(bench, 60, seed=1)
    assert {success for _, success in answers} == {True, False}
    assert bench.state == bench.node._phase
    assert not [line for line in bench.logs if "failed" in line]
    for state in ("unconfigured", "inactive"):
        if bench.state == state:
            assert bench.change_state({"unconfigured": "configure", "inactive": "activate"}[state])
    bench.connect()
    bench.await_depth()


@pytest.mark.endurance
def test_thousands_of_such_requests_take_no_memory(start: Callable[..., Any]) -> None:
    bench = start()
    bench.until(lambda: bench.state == "active")
    race(bench, 500, seed=2)
    before = resident_mib()
    assert len(race(bench, 2000, seed=3)) == 2000
    assert resident_mib() < before + 20
    assert bench.state == bench.node._phase


def test_answers_of_one_client_follow_the_state(start: Callable[..., Any]) -> None:
    bench = start(autostart=False)
    rng, state = random.Random(4), "unconfigured"
    for _ in range(20):
        label = rng.choice(LABELS)
        assert bench.change_state(label) == ((state, label) in AFTER)
        state = AFTER.get((state, label), state)
        assert bench.state == bench.node._phase == state


def test_a_parameter_of_no_type_is_refused_with_an_answer(start: Callable[..., Any]) -> None:
    bench = start()
    refusals = []
    for service, name in ((SetParameters, "set_parameters"), (SetParametersAtomically, "set_parameters_atomically")):
        client = bench.peer.create_client(service, f"radcam_depth/{name}")
        response = bench._call(client, service.Request(parameters=[NO_TYPE]))
        refusals += response.results if service is SetParameters else [response.result]
    assert [(result.successful, "99" in result.reason) for result in refusals] == [(False, True)] * 2
    assert bench.set_parameter("max_wait_s", 0.05) == ""


def test_a_node_that_a_manager_configures_first_still_starts_by_itself(start: Callable[..., Any]) -> None:
    bench = start(autostart=False)
    assert bench.change_state("configure")
    bench.node._on_start()
    assert bench.state == "active"
    bench.node._on_start()
    assert bench.state == "active"
