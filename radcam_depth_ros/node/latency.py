"""Measures each frame's latency from the image's arrival to its depth, in parts, and publishes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import QoSProfile, ReliabilityPolicy

from radcam_depth_ros.node.health import Durations
from radcam_depth_ros.node.topics.factory import build_message, message_class

LATENCY_PARTS = ("latency", "decode", "wait", "inference", "encode")
LATENCY_TOPICS = {part: f"debug/{part}_ms" for part in LATENCY_PARTS}
"""Relative topic of each part, std_msgs/Float32."""
_TYPE = "std_msgs/msg/Float32"


@dataclass(frozen=True)
class FrameTimes:
    """When a frame got where, nanoseconds on the steady clock.

    Attributes:
        arrived_ns: Its image came.
        decoded_ns: The image was decoded and handed to the pairing.
        taken_ns: The worker took the frame, which had waited for radar sweeps and for the frame before it.
        estimated_ns: The network was done.
        published_ns: The messages were written and published.
    """

    arrived_ns: int
    decoded_ns: int
    taken_ns: int
    estimated_ns: int
    published_ns: int

    def durations_ns(self) -> Mapping[str, int]:
        """The whole, `latency`, and what it is made of, for each of `LATENCY_PARTS`."""
        return {
            "latency": self.published_ns - self.arrived_ns,
            "decode": self.decoded_ns - self.arrived_ns,
            "wait": self.taken_ns - self.decoded_ns,
            "inference": self.estimated_ns - self.taken_ns,
            "encode": self.published_ns - self.estimated_ns,
        }


class Latencies:
    """The last frames' times, part by part."""

    def __init__(self) -> None:
        self._parts = {part: Durations() for part in LATENCY_PARTS}

    def add(self, times: FrameTimes) -> None:
        """Takes a frame's times."""
        for part, duration_ns in times.durations_ns().items():
            self._parts[part].add(duration_ns)

    def percentiles_ms(self, part: str) -> tuple[float, ...]:
        """Milliseconds at 50, 95 and 99 % of one of `LATENCY_PARTS`; empty before the first frame."""
        return self._parts[part].percentiles_ms()

    def values(self) -> tuple[tuple[str, str], ...]:
        """All percentiles as diagnostics values."""
        return tuple(
            (f"{part} {name} [ms]", f"{value:.1f}")
            for part in LATENCY_PARTS
            for name, value in zip(("p50", "p95", "p99"), self.percentiles_ms(part), strict=False)
        )


class LatencyTopics:
    """Publishes each frame's times while the node is active, where somebody subscribes.

    Args:
        node: The node.
    """

    def __init__(self, node: LifecycleNode) -> None:
        self._node = node
        self._publishers: dict[str, LifecyclePublisher] = {
            part: node.create_lifecycle_publisher(
                message_class(_TYPE), topic, QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
            )
            for part, topic in LATENCY_TOPICS.items()
        }

    def publish(self, times: FrameTimes) -> None:
        """Publishes a frame's times, milliseconds."""
        for part, duration_ns in times.durations_ns().items():
            publisher = self._publishers.get(part)
            if publisher is not None and publisher.get_subscription_count() > 0:
                publisher.publish(build_message(_TYPE, data=duration_ns / 1e6))

    def destroy(self) -> None:
        """Takes the publishers down."""
        for publisher in self._publishers.values():
            self._node.destroy_lifecycle_publisher(publisher)
        self._publishers.clear()
