"""Subscriptions of the node; those of radars follow the types of their topics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from rclpy.clock import Clock
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.node.topics.inputs import OVERRIDABLE, Input, Inputs, has_messages
from radcam_depth_ros.printable import printable

TYPES_PERIOD_S = 0.2
"""The types of topics are looked at so often; a look takes a tenth of a millisecond."""


class Subscriptions:
    """Subscribes to inputs, and again where the type of a radar's topic is another one than it was.

    Args:
        node: The node.
        inputs: What to read.
        on_message: Called with the input, each message's bytes, and its publisher's number of it, None where it has
            none.
        on_problem: Called with the input's part and a sentence when a publisher cannot be heard.
        on_well: Called with the input's part when what was wrong with its type is over.
        clock: By which the types are looked at.

    Attributes:
        inputs: What is read; the types of radars are those of their topics.
    """

    def __init__(
        self,
        node: Node,
        inputs: Inputs,
        on_message: Callable[[Input, bytes, int | None], None],
        on_problem: Callable[[str, str], None],
        on_well: Callable[[str], None],
        clock: Clock,
    ) -> None:
        self._node, self._on_message, self._on_problem, self._on_well = node, on_message, on_problem, on_well
        self.inputs = inputs
        self._unreadable: dict[str, str] = {}  # by part: the type that its topic has
        self._subscriptions: dict[str, Subscription] = {}
        self._look = node.create_timer(TYPES_PERIOD_S, self._follow_types, clock=clock)
        try:
            self._follow_types()
            for source in self.inputs:
                self._subscribe(source)
        except Exception:
            self.close()
            raise

    def qos(self, source: Input) -> QoSProfile:
        """What an input is subscribed with, parameters counted in."""
        subscription = self._subscriptions.get(source.part)
        return source.qos if subscription is None else subscription.qos_profile

    def close(self) -> None:
        """Ends all of them."""
        self._node.destroy_timer(self._look)
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _follow_types(self) -> None:
        for source in self.inputs.radars:
            type_name = self._published_type(source)
            if type_name == source.type_name:
                self._settle(source)
            elif has_messages(type_name):
                self._change(source, replace(source, type_name=type_name))
            elif self._unreadable.get(source.part) != type_name:
                self._unreadable[source.part] = type_name
                package = type_name.partition("/")[0]
                self._on_problem(
                    source.part,
                    f"{source.topic} is published as {type_name}, which cannot be read since {package} is not "
                    f"installed: install ros-jazzy-{package.replace('_', '-')} and start the node anew, or set "
                    f"{source.parameter} to a topic of {source.type_name}",
                )

    def _published_type(self, source: Input) -> str:
        """The type that a topic has: the present one as long as somebody publishes that, or none that is read."""
        types = {info.topic_type for info in self._node.get_publishers_info_by_topic(source.topic)}
        return next((name for name in (source.type_name, *source.accepted) if name in types), source.type_name)

    def _change(self, source: Input, changed: Input) -> None:
        radars = tuple(changed if radar == source else radar for radar in self.inputs.radars)
        self.inputs = replace(self.inputs, radars=radars)
        before = self._subscriptions.pop(source.part, None)
        if before is not None:
            self._node.destroy_subscription(before)
            self._subscribe(changed)
            sentence = f"{source.part}: its topic is published as {changed.type_name}, and read as that from now on"
            self._node.get_logger().info(printable(sentence))
        self._settle(source)

    def _settle(self, source: Input) -> None:
        if self._unreadable.pop(source.part, None):
            self._on_well(source.part)

    def _subscribe(self, source: Input) -> None:
        def on_incompatible(event: QoSRequestedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            self._on_problem(
                source.part,
                f"a publisher on {source.topic} offers an incompatible quality of service, nothing of it will be "
                f"heard: its {policy} does not meet what this node asks for; set the parameter qos_overrides."
                f"{source.topic}.subscription.{policy.lower()} to what it offers, or change the publisher",
            )

        def on_other_type(_: object) -> None:
            if not source.types:  # else the type is followed
                sentence = f"expected {source.type_name} on {source.topic}, somebody publishes another type"
                self._on_problem(source.part, sentence)

        def take(raw: bytes, info: Mapping[str, int | None]) -> None:
            self._on_message(source, raw, info["publication_sequence_number"])

        self._subscriptions[source.part] = self._node.create_subscription(
            message_class(source.type_name),
            source.topic,
            take,  # type: ignore[arg-type]  # rclpy's annotation lacks the second form
            source.qos,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=on_incompatible, incompatible_type=on_other_type
            ),
            qos_overriding_options=QoSOverridingOptions(OVERRIDABLE),
            raw=True,
        )
