"""Decodes and encodes transforms and odometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.geometry import GeometryError, RigidTransform
from radcam_depth_ros.messages.wire import (
    LARGEST_M,
    MessageError,
    MessageFactory,
    make_header,
    require_fields,
    stamp_ns,
)

_COVARIANCE_SIZE = 36


@dataclass(frozen=True)
class StampedTransform:
    """One link of a transform tree.

    Attributes:
        parent_frame: The message's header.frame_id.
        child_frame: The frame that is placed in its parent.
        stamp_ns: Nanoseconds.
        parent_from_child: Takes points of the child to the parent.
    """

    parent_frame: str
    child_frame: str
    stamp_ns: int
    parent_from_child: RigidTransform


@dataclass(frozen=True)
class OdometryReading:
    """Where a vehicle is and how it moves.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The frame in which the pose is given.
        child_frame_id: The vehicle's frame, in which the velocities are given.
        pose: Takes points of `child_frame_id` to `frame_id`.
        linear: (3,) float64, m/s.
        angular: (3,) float64, rad/s.
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: RigidTransform
    linear: npt.NDArray[np.float64]
    angular: npt.NDArray[np.float64]


def decode_transforms(message: Any) -> tuple[StampedTransform, ...]:
    """Reads a tf2_msgs/TFMessage.

    Raises:
        MessageError: for a rotation or translation that is none, naming its frames.
    """
    require_fields(message, "tf2_msgs/TFMessage", "transforms")
    return tuple(_decode_transform(stamped) for stamped in message.transforms)


def _decode_transform(stamped: Any) -> StampedTransform:
    parent, child = str(stamped.header.frame_id), str(stamped.child_frame_id)
    pose = _rigid(
        stamped.transform.translation, stamped.transform.rotation, f"the transform from {child!r} to {parent!r}"
    )
    return StampedTransform(parent, child, stamp_ns(stamped.header), pose)


def encode_transforms(factory: MessageFactory, transforms: Sequence[StampedTransform]) -> Any:
    """Writes a tf2_msgs/TFMessage."""
    messages = []
    for link in transforms:
        transform = factory(
            "geometry_msgs/msg/Transform",
            translation=_vector(factory, "Vector3", link.parent_from_child.translation),
            rotation=_quaternion(factory, link.parent_from_child),
        )
        stamped = factory(
            "geometry_msgs/msg/TransformStamped",
            header=make_header(factory, link.stamp_ns, link.parent_frame),
            child_frame_id=link.child_frame,
            transform=transform,
        )
        messages.append(stamped)
    return factory("tf2_msgs/msg/TFMessage", transforms=messages)


def decode_odometry(message: Any) -> OdometryReading:
    """Reads a nav_msgs/Odometry.

    Raises:
        MessageError: for a pose that is none.
    """
    require_fields(message, "nav_msgs/Odometry", "header", "child_frame_id", "pose", "twist")
    pose, twist = message.pose.pose, message.twist.twist
    return OdometryReading(
        stamp_ns(message.header),
        str(message.header.frame_id),
        str(message.child_frame_id),
        _rigid(pose.position, pose.orientation, f"the odometry of {str(message.child_frame_id)!r}"),
        _values(twist.linear),
        _values(twist.angular),
    )


def encode_odometry(factory: MessageFactory, odometry: OdometryReading) -> Any:
    """Writes a nav_msgs/Odometry; covariances are 0, which means unknown."""
    pose = factory(
        "geometry_msgs/msg/Pose",
        position=_vector(factory, "Point", odometry.pose.translation),
        orientation=_quaternion(factory, odometry.pose),
    )
    twist = factory(
        "geometry_msgs/msg/Twist",
        linear=_vector(factory, "Vector3", odometry.linear),
        angular=_vector(factory, "Vector3", odometry.angular),
    )
    unknown = np.zeros(_COVARIANCE_SIZE)
    return factory(
        "nav_msgs/msg/Odometry",
        header=make_header(factory, odometry.stamp_ns, odometry.frame_id),
        child_frame_id=odometry.child_frame_id,
        pose=factory("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
        twist=factory("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown.copy()),
    )


def _rigid(translation: Any, rotation: Any, what: str) -> RigidTransform:
    quaternion = [rotation.x, rotation.y, rotation.z, rotation.w]
    position_m = [translation.x, translation.y, translation.z]
    for name, values in (("translation in metres", position_m), ("quaternion", quaternion)):
        if not all(abs(value) < LARGEST_M for value in values):  # NaN is not
            raise MessageError(
                f"{what} can't be used: expected a {name} of numbers below {LARGEST_M:g}, got {values}; fix who "
                "publishes it"
            )
    try:
        return RigidTransform.from_quaternion(position_m, quaternion)
    except GeometryError as error:
        raise MessageError(f"{what} can't be used: {error}") from error


def _values(vector: Any) -> npt.NDArray[np.float64]:
    return np.array([vector.x, vector.y, vector.z], np.float64)


def _vector(factory: MessageFactory, name: str, values: npt.NDArray[np.float64]) -> Any:
    x, y, z = (float(value) for value in values)
    return factory(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)


def _quaternion(factory: MessageFactory, pose: RigidTransform) -> Any:
    x, y, z, w = pose.quaternion
    return factory("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
