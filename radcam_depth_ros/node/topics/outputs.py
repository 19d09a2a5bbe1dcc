"""Publishers of the node, with their quality of service."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSOfferedIncompatibleQoSInfo
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions

from radcam_depth_ros.encoder import OUTPUTS, Output
from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.node.topics.inputs import OVERRIDABLE


class Outputs:
    """The publishers, which publish while the node is active.

    Args:
        node: The node.
        on_problem: Called with a sentence when a subscriber cannot hear.
    """

    def __init__(self, node: LifecycleNode, on_problem: Callable[[str], None]) -> None:
        self._node = node
        self._on_problem = on_problem
        self._publishers: dict[str, LifecyclePublisher] = {}
        try:
            self.offer(has_classes=False)
        except Exception:
            self.destroy()
            raise

    def offer(self, *, has_classes: bool) -> None:
        """Makes the publishers of a network with or without a class output; those that are there stay."""
        for name, output in OUTPUTS.items():
            is_offered = has_classes or not output.needs_classes
            if is_offered and name not in self._publishers:
                self._publishers[name] = self._create(output)
            elif not is_offered and name in self._publishers:
                self._node.destroy_lifecycle_publisher(self._publishers.pop(name))

    def wanted(self) -> tuple[str, ...]:
        """Names of the outputs to make now: those on demand only while they have a subscriber, and can be made."""
        return tuple(
            name
            for name, publisher in self._publishers.items()
            if not OUTPUTS[name].is_on_demand or (publisher.get_subscription_count() > 0 and self._can_make(name))
        )

    def _can_make(self, name: str) -> bool:
        problem = OUTPUTS[name].problem()
        if problem:
            self._on_problem(f"{OUTPUTS[name].topic} has subscribers, who will hear nothing: {problem}")
        return not problem

    def publish(self, messages: Mapping[str, Any]) -> None:
        """Publishes a frame's messages, by the names of their outputs."""
        for name, message in messages.items():
            if name in self._publishers:
                self._publishers[name].publish(message)

    def subscribers(self) -> tuple[tuple[str, str], ...]:
        """How many subscribe to each topic, as diagnostics values."""
        return tuple(
            (OUTPUTS[name].topic, f"{publisher.get_subscription_count()} subscribers")
            for name, publisher in self._publishers.items()
        )

    def destroy(self) -> None:
        """Takes the publishers down."""
        for publisher in self._publishers.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._publishers.clear()

    def _create(self, output: Output) -> LifecyclePublisher:
        topic = output.topic

        def on_incompatible(event: QoSOfferedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            self._on_problem(
                f"a subscriber on {topic} asks for an incompatible quality of service and will hear nothing: its "
                f"{policy} is more than this node offers; change the subscriber, or set the parameter "
                f"qos_overrides.{self._node.resolve_topic_name(topic)}.publisher.{policy.lower()}"
            )

        publisher: LifecyclePublisher = self._node.create_lifecycle_publisher(
            message_class(output.type_name),
            topic,
            # A reliable writer serves both kinds of readers.
            QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE),
            event_callbacks=PublisherEventCallbacks(incompatible_qos=on_incompatible),
            qos_overriding_options=QoSOverridingOptions(OVERRIDABLE),
        )
        return publisher
