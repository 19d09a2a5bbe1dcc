"""What the node publishes, and with which quality of service."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.event_handler import PublisherEventCallbacks, QoSOfferedIncompatibleQoSInfo
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions

from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.pipeline import OUTPUT_TOPICS, DepthMessages

_TYPES = {
    "depth_camera_info": "sensor_msgs/msg/CameraInfo",
    "semi_dense_camera_info": "sensor_msgs/msg/CameraInfo",
    "points": "sensor_msgs/msg/PointCloud2",
}
OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
"""Policies that `qos_overrides.<topic>.publisher.*` parameters change."""


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
            for name in OUTPUT_TOPICS:
                if name != "classes":
                    self._publishers[name] = self._create(name)
        except Exception:
            self.destroy()
            raise

    def offer_classes(self, offered: bool) -> None:
        """Whether there is a topic of class images: it comes and goes with networks that tell, the others stay."""
        if offered and "classes" not in self._publishers:
            self._publishers["classes"] = self._create("classes")
        elif not offered and "classes" in self._publishers:
            self._node.destroy_lifecycle_publisher(self._publishers.pop("classes"))

    def is_wanted(self, name: str) -> bool:
        """Whether anybody subscribes to an output, by its field's name in `DepthMessages`."""
        publisher = self._publishers.get(name)
        return publisher is not None and bool(publisher.get_subscription_count() > 0)

    def publish(self, messages: DepthMessages) -> None:
        """Publishes what a frame gave."""
        for name, publisher in self._publishers.items():
            message = getattr(messages, name)
            if message is not None:
                publisher.publish(message)

    def subscribers(self) -> tuple[tuple[str, str], ...]:
        """How many subscribe to each topic, as diagnostics values."""
        return tuple(
            (OUTPUT_TOPICS[name], f"{publisher.get_subscription_count()} subscribers")
            for name, publisher in self._publishers.items()
        )

    def destroy(self) -> None:
        """Takes the publishers down."""
        for publisher in self._publishers.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._publishers.clear()

    def _create(self, name: str) -> LifecyclePublisher:
        topic = OUTPUT_TOPICS[name]

        def on_incompatible(event: QoSOfferedIncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            self._on_problem(
                f"a subscriber on {topic} asks for an incompatible quality of service and will hear nothing: its "
                f"{policy} is more than this node offers; change the subscriber, or set the parameter "
                f"qos_overrides.{self._node.resolve_topic_name(topic)}.publisher.{policy.lower()}"
            )

        publisher: LifecyclePublisher = self._node.create_lifecycle_publisher(
            message_class(_TYPES.get(name, "sensor_msgs/msg/Image")),
            topic,
            # A reliable writer serves both kinds of readers.
            QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE),
            event_callbacks=PublisherEventCallbacks(incompatible_qos=on_incompatible),
            qos_overriding_options=QoSOverridingOptions(OVERRIDABLE),
        )
        return publisher
