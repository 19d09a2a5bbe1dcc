"""Queries of the ROS graph for an input: its publishers, and other topics of its type."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from difflib import SequenceMatcher

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from radcam_depth_ros.encoder import OUTPUTS
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX
from radcam_depth_ros.node.topics.inputs import COMPRESSED, TRANSPORT_TYPES, Input

_TELLING = (OUTPUTS["semi_dense"].topic, OUTPUTS["confidence"].topic)
"""Topics that nothing else publishes both of."""


class Graph:
    """Looks at the graph from where a node is.

    Args:
        node: The node; what it publishes itself is no input of its own.
        read: The topics that it reads; none of them is proposed in place of another.
    """

    def __init__(self, node: Node, read: Collection[str] = ()) -> None:
        self._node = node
        self._read = frozenset(read)

    def publishers(self, source: Input, asked: QoSProfile) -> str:
        """Who publishes on an input's topic: how many, and which of them cannot be heard since type or policy differ.

        Args:
            source: The input.
            asked: What it is subscribed with.
        """
        found = self._others(source.topic)
        faults = Counter(fault for info in found if (fault := _fault(info, source, asked)))
        count = f"{len(found) or 'no'} publisher{'' if len(found) == 1 else 's'}"
        return f"{count}: {', '.join(f'{faults[fault]} {fault}' for fault in faults)}" if faults else count

    def remedy(self, source: Input, asked: QoSProfile, beside: str = "") -> str:
        """Why nothing comes on an input's topic as far as the graph tells, and what to do.

        Args:
            source: The input.
            asked: What it is subscribed with.
            beside: A topic that belongs to the same sensor: of others, one in its namespace is proposed first.
        """
        found = self._others(source.topic)
        same = [info for info in found if info.topic_type in source.accepted]
        refused = [mismatch for info in same if (mismatch := mismatches(info.qos_profile, asked))]
        if not found:
            return f"nobody publishes it{self._where_else(source, beside)}"
        if not same:
            other = found[0].topic_type
            return f"it is published as {other}: {_other_type(source, source.topic, other)}"
        if len(refused) == len(same):
            policy, offered = refused[0][0]
            return (
                f"its publisher offers {policy} {offered}, less than this node asks for: set the parameter "
                f"qos_overrides.{source.topic}.subscription.{policy.lower()} to {offered}, or change the publisher"
            )
        return "it has a publisher, which is silent: see whether the sensor and its driver run"

    def nearest(self, topic: str, types: Collection[str], beside: str = "") -> str | None:
        """The topic of some types, of those that others publish, whose name is most like a topic's; None where none is.

        Outputs of other nodes of this kind are none.
        """
        siblings = self._of_this_kind()
        wanted = (topic, *((f"{beside.rpartition('/')[0]}/{topic.rpartition('/')[2]}",) if beside else ()))
        candidates = [
            name
            for name, its_types in self._node.get_topic_names_and_types()
            if not set(types).isdisjoint(its_types) and name not in self._read
            if any((info.node_name, info.node_namespace) not in siblings for info in self._others(name))
        ]
        return max(
            sorted(candidates),
            key=lambda name: max(SequenceMatcher(None, name, like).ratio() for like in wanted),
            default=None,
        )

    def _others(self, topic: str) -> list[TopicEndpointInfo]:
        own = (self._node.get_name(), self._node.get_namespace())
        infos: list[TopicEndpointInfo] = self._node.get_publishers_info_by_topic(topic)
        return [info for info in infos if (info.node_name, info.node_namespace) != own]

    def _of_this_kind(self) -> set[tuple[str, str]]:
        """Name and namespace of the nodes of this kind, which are known by what they publish, whatever their name."""
        topics = [name for name, _ in self._node.get_topic_names_and_types()]
        publishers = [
            {
                (info.node_name, info.node_namespace)
                for topic in topics
                if topic.endswith(f"/{output}")
                for info in self._node.get_publishers_info_by_topic(topic)
            }
            for output in _TELLING
        ]
        return set.intersection(*publishers)

    def _where_else(self, source: Input, beside: str) -> str:
        nearest = self.nearest(source.topic, source.accepted, beside)
        # Where the name is fixed, it tells what is on it: /tf and /tf_static are of one type.
        is_fit = source.parameter or (nearest or "").rpartition("/")[2] == source.topic.rpartition("/")[2]
        if nearest is not None and is_fit:
            name = f"set {source.parameter} to it, or " if source.parameter else ""
            return f"; of this type there is {nearest}: {name}remap {source.topic}{'' if name else ' to it'}"
        for other in _other_image_types(source):
            nearest = self.nearest(source.topic, (other,))
            if nearest is not None:
                return f", but {nearest} is {other}: {_other_type(source, nearest, other)}"
        return f", nor anything else of this type: {source.otherwise}, and see that both have one ROS_DOMAIN_ID"


def mismatches(offered: QoSProfile, asked: QoSProfile) -> tuple[tuple[str, str], ...]:
    """The policies of which a publisher offers less than a subscription asks for, each with what is offered."""
    reliability = (offered.reliability, asked.reliability) == (
        ReliabilityPolicy.BEST_EFFORT,
        ReliabilityPolicy.RELIABLE,
    )
    durability = (offered.durability, asked.durability) == (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
    return (
        *((("RELIABILITY", "best_effort"),) if reliability else ()),
        *((("DURABILITY", "volatile"),) if durability else ()),
    )


def _fault(info: TopicEndpointInfo, source: Input, asked: QoSProfile) -> str:
    if info.topic_type not in source.accepted:
        return f"of {info.topic_type}"
    found = mismatches(info.qos_profile, asked)
    return f"with {', '.join(f'{policy} {offered}' for policy, offered in found)}" if found else ""


def _other_image_types(source: Input) -> tuple[str, ...]:
    types = tuple(TRANSPORT_TYPES.values())
    return tuple(other for other in types if other != source.type_name) if source.type_name in types else ()


def _other_type(source: Input, topic: str, type_name: str) -> str:
    """What to do where a topic has another type than an input."""
    if type_name not in _other_image_types(source):
        what = f"set {source.parameter}" if source.parameter else f"remap {source.topic}"
        return f"{what} to a topic of {source.expected}"
    (transport,) = (name for name, image_type in TRANSPORT_TYPES.items() if image_type == type_name)
    if transport == COMPRESSED and not topic.endswith(COMPRESSED_SUFFIX):
        transport = "compressed_topic"
    return f"set image_transport to {transport} and {source.parameter} to {topic}"
