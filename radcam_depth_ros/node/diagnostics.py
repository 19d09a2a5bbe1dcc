"""Publishes the node's state as `/diagnostics`: one status for the whole and one for each part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from radcam_depth_ros.estimator import Computation
from radcam_depth_ros.messages import MessageFactory
from radcam_depth_ros.node.health import Level, Problems, Status, summary
from radcam_depth_ros.node.vitals import Vitals
from radcam_depth_ros.printable import printable

_PARTS = ("camera", "radar", "calibration", "pairing", "inference", "output")


@dataclass(frozen=True)
class Snapshot:
    """What diagnostics are made from.

    Attributes:
        phase: The lifecycle state: unconfigured, inactive, active or finalized.
        model: What the estimator says of itself; empty when none is loaded.
        vitals: How the parts do while the node is active.
        computation: What the digits of the depth follow from; None when no network is loaded.
    """

    phase: str
    model: str = ""
    vitals: Vitals | None = None
    computation: Computation | None = None


class Diagnostics:
    """Says of each part of the node how it does, and of the whole.

    Args:
        node: The node; its fully qualified name begins the name of each status, so that nodes of one name stay apart.
        problems: What was reported.
    """

    def __init__(self, node: Node, problems: Problems) -> None:
        self._node = node
        self._problems = problems

    def message(self, statuses: tuple[Status, ...], factory: MessageFactory) -> Any:
        """A diagnostic_msgs/DiagnosticArray."""
        return factory(
            "diagnostic_msgs/msg/DiagnosticArray",
            header=factory("std_msgs/msg/Header", stamp=self._node.get_clock().now().to_msg(), frame_id=""),
            status=[self._status_message(status, factory) for status in statuses],
        )

    def statuses(self, snapshot: Snapshot) -> tuple[Status, ...]:
        """One line for the whole, `health`, and one for each part."""
        stale = f"the node is {snapshot.phase}"
        running = (
            snapshot.vitals.statuses()
            if snapshot.vitals
            else tuple(Status(part, Level.STALE, stale) for part in _PARTS)
        )
        parts = (*running, self._model(snapshot))
        return (summary(parts), *parts)

    def _status_message(self, status: Status, factory: MessageFactory) -> Any:
        return factory(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=bytes([status.level]),
            name=f"{self._node.get_fully_qualified_name()}: {status.name}",
            message=printable(status.message),
            hardware_id=self._node.get_fully_qualified_name(),
            values=[
                factory("diagnostic_msgs/msg/KeyValue", key=key, value=printable(value)) for key, value in status.values
            ],
        )

    def _model(self, snapshot: Snapshot) -> Status:
        computed = snapshot.computation.values() if snapshot.computation else ()
        problem = self._problems.show("model", "parameters")
        if problem:
            return Status("model", *problem, (*computed, *self._problems.history("model", "parameters")))
        if not snapshot.model:
            return Status("model", Level.STALE, f"no network is loaded, the node is {snapshot.phase}")
        return Status("model", Level.OK, snapshot.model, computed)
