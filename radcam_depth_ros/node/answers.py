"""Answers every request to the node's services; rclpy leaves those unanswered whose callback raises."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode
from rclpy.service import Service

from radcam_depth_ros.printable import printable


class Answers:
    """Wraps the services that a node has: lifecycle and parameters.

    A transition that is not possible in the node's state is answered with `success` false, and the state stays. A
    request that fails otherwise gets the empty response of its type; one to set parameters gets the reason as well.

    Args:
        node: The node, with all of its services.
        on_refusal: Called with a sentence for a transition that is not possible.
        on_error: Called with what a callback raised.
    """

    def __init__(
        self, node: LifecycleNode, on_refusal: Callable[[str], None], on_error: Callable[[Exception], None]
    ) -> None:
        self._on_refusal, self._on_error = on_refusal, on_error
        services: list[Service] = list(node.services)
        self._state = _callback(services, GetState)
        self._transitions = _callback(services, GetAvailableTransitions)
        for service in services:
            answer = self._change_state if service.srv_type is ChangeState else self._answer
            service.callback = partial(answer, service.callback)

    def _change_state(self, callback: Callable[..., Any], request: Any, response: Any) -> Any:
        asked = request.transition
        found = self._transitions(GetAvailableTransitions.Request(), GetAvailableTransitions.Response())
        possible = [entry.transition for entry in found.available_transitions]
        # As in rclpy, a label counts more than a number.
        if any(entry.label == asked.label if asked.label else entry.id == asked.id for entry in possible):
            return self._answer(callback, request, response)
        state = self._state(GetState.Request(), GetState.Response()).current_state.label
        choice = ", ".join(entry.label for entry in possible) or "none"
        self._on_refusal(
            f"expected a transition that is possible in the state {state} ({choice}), got "
            f"{asked.label or asked.id!r}; the state stays, ask for one of these"
        )
        response.success = False
        return response

    def _answer(self, callback: Callable[..., Any], request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # the boundary: who asks waits for an answer
            self._on_error(error)
            return _failure(request, type(response), f"this request failed: {printable(str(error))}")


def _callback(services: list[Service], service_type: type) -> Callable[..., Any]:
    # The graph of all transitions has the type of those that are possible now, and comes after them.
    found: Callable[..., Any] = next(service.callback for service in services if service.srv_type is service_type)
    return found


def _failure(request: Any, response_type: Any, reason: str) -> Any:
    """A response of a type that says that nothing was done."""
    result = SetParametersResult(successful=False, reason=reason)
    if response_type is SetParameters.Response:
        return response_type(results=[result] * len(request.parameters))
    if response_type is SetParametersAtomically.Response:
        return response_type(result=result)
    return response_type()
