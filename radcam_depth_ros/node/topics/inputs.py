"""The topics that the node reads, by its parameters, with their quality of service."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.validate_topic_name import validate_topic_name

from radcam_depth_ros.bags import RADAR_TYPES
from radcam_depth_ros.frame_builder import COMPRESSED_SUFFIX, TRANSFORM_TOPICS
from radcam_depth_ros.node.topics.factory import message_class
from radcam_depth_ros.parameters import NodeConfig, ParameterError

TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
COMPRESSED = "compressed"
TRANSPORT_TYPES = {"raw": "sensor_msgs/msg/Image", COMPRESSED: "sensor_msgs/msg/CompressedImage"}
"""Of values of `image_transport`; `compressed_topic` takes compressed images as well."""
OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
"""Policies that `qos_overrides.<topic>.subscription.*` and `.publisher.*` parameters change."""


@dataclass(frozen=True)
class Input:
    """One topic that is read.

    Attributes:
        part: What it is, in diagnostics and logs.
        topic: Its full name, remapped.
        type_name: As in `sensor_msgs/msg/Image`. It may change, and tells inputs not apart.
        depth: How many messages wait at most.
        is_latched: The last message is wanted even if it came before the node.
        parameter: The one that names the topic; empty where its name is fixed.
        otherwise: What to do where nothing publishes its type.
        types: All types that are read, where there are several: the topic's own counts, before it is there the first.
    """

    part: str
    topic: str
    type_name: str = field(compare=False)
    depth: int
    is_latched: bool = False
    parameter: str = ""
    otherwise: str = "start the driver"
    types: tuple[str, ...] = ()

    @property
    def accepted(self) -> tuple[str, ...]:
        """All types that its topic may have."""
        return self.types or (self.type_name,)

    @property
    def expected(self) -> str:
        """All of these, for a sentence."""
        return " or ".join(self.accepted)

    @property
    def qos(self) -> QoSProfile:
        """Best effort, since a reliable reader would hear nothing of a best-effort sensor; latched is reliable."""
        return QoSProfile(
            depth=self.depth,
            reliability=ReliabilityPolicy.RELIABLE if self.is_latched else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if self.is_latched else DurabilityPolicy.VOLATILE,
        )


@dataclass(frozen=True)
class Inputs:
    """All topics that are read.

    Attributes:
        camera: The images.
        camera_info: The camera's calibration.
        radars: The radars' clouds or scans, in the order of the parameter.
        transforms: `/tf_static` and `/tf`; empty where tf2_msgs is not installed.
        odometry: How the vehicle moves; None where it is not needed, or /tf tells.
        motion: What tells how the vehicle moves, odometry or `/tf`; None where it is not needed.
        extrinsics: `/tf_static`, where it tells where the radars are; None where parameters do.
    """

    camera: Input
    camera_info: Input
    radars: tuple[Input, ...]
    transforms: tuple[Input, ...]
    odometry: Input | None = None
    motion: Input | None = None
    extrinsics: Input | None = None

    def __iter__(self) -> Any:
        moving = () if self.odometry is None else (self.odometry,)
        return iter((self.camera, self.camera_info, *self.radars, *self.transforms, *moving))


def find_inputs(node: Node, config: NodeConfig) -> Inputs:
    """The topics that a config names, as the node's namespace and remappings make them.

    Raises:
        ParameterError: for a name that is none.
    """
    given, transport = config.frame_builder, config.image_transport
    image = _full_name(node, given.image)
    if transport == COMPRESSED:
        # As image_transport does, which may have its own topics remapped as well.
        image = _full_name(node, image.removesuffix(COMPRESSED_SUFFIX) + COMPRESSED_SUFFIX)
    image_type = TRANSPORT_TYPES.get(transport, TRANSPORT_TYPES[COMPRESSED])
    radars = tuple(_full_name(node, topic) for topic in given.radars)
    static, dynamic = _transforms()
    has_transforms = has_transform_messages()
    odometry = None
    if given.moves_radar and given.odometry:
        odometry = Input(
            "odometry",
            _full_name(node, given.odometry),
            ODOMETRY_TYPE,
            50,
            parameter="odometry_topic",
            otherwise="start what computes the vehicle's odometry, or set odometry_topic to an empty text to take /tf",
        )
    return Inputs(
        camera=Input("camera", image, image_type, 2, parameter="image_topic"),
        camera_info=Input(
            "camera_info",
            _full_name(node, given.calibration_topic),
            "sensor_msgs/msg/CameraInfo",
            2,
            parameter="camera_info_topic",
        ),
        radars=tuple(
            Input(f"radar {topic}", topic, RADAR_TYPES[0], 10, parameter="radar_topics", types=RADAR_TYPES)
            for topic in radars
        ),
        transforms=(static, dynamic) if has_transforms else (),
        odometry=odometry,
        extrinsics=static if has_transforms and given.needs_transforms else None,
        motion=odometry or (dynamic if has_transforms and given.moves_radar else None),
    )


def _transforms() -> tuple[Input, Input]:
    static, dynamic = TRANSFORM_TOPICS
    return (
        Input(
            "transforms",
            static,
            TRANSFORM_TYPE,
            100,
            is_latched=True,
            otherwise="start robot_state_publisher or static_transform_publisher, or set camera_from_radar",
        ),
        Input(
            "moving transforms",
            dynamic,
            TRANSFORM_TYPE,
            100,
            otherwise="start what publishes odom_frame on it, or set odometry_topic",
        ),
    )


def _full_name(node: Node, topic: str) -> str:
    try:
        validate_topic_name(topic)
    except InvalidTopicNameException as error:
        reason = str(error).splitlines()[0].removeprefix("Invalid topic name: ")
        raise ParameterError(f"expected the name of a topic in the parameters, got {topic!r}: {reason}") from None
    return str(node.resolve_topic_name(topic))


def has_transform_messages() -> bool:
    """Whether tf2_msgs is installed; it is not on PyPI."""
    return has_messages(TRANSFORM_TYPE)


def has_messages(type_name: str) -> bool:
    """Whether the package of a type is installed."""
    try:
        message_class(type_name)
    except ModuleNotFoundError:
        return False
    return True
