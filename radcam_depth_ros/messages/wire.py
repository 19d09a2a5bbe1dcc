"""Parts common to all messages: the error, the header, the bytes of `data`, and the message factory.

Messages are any objects with the ROS attribute names, those of rclpy and those of rosbags alike; neither is imported.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from radcam_depth_ros.frame import ImageArray, RadcamDepthError

NANOSECONDS = 1_000_000_000
LARGEST_M = 1e9
"""No position is so far away; a float32 of metres has room for what is made of those that are nearer."""
_LARGEST_SIDE_PX = 32_767
"""OpenCV's remap takes no more."""
_LARGEST_IMAGE_PX = 50_000_000


class MessageError(RadcamDepthError):
    """A message that cannot be read, or values that cannot be written as one."""


class MessageFactory(Protocol):
    """Builds messages, so that encoding runs with rclpy and with rosbags.

    Every field that has a meaning is given; fields left out take the type's default. Nested messages come from the
    same factory, numbers are Python's, sequences of bytes or float64 are one-dimensional contiguous numpy arrays
    (`data` is uint8 and may be a view of the caller's memory), sequences of messages are lists.
    """

    def __call__(self, type_name: str, **fields: object) -> Any:
        """Builds one message.

        Args:
            type_name: As in `sensor_msgs/msg/Image`.
            **fields: Values by field name.
        """
        ...


def stamp_ns(header: Any) -> int:
    """Nanoseconds of a std_msgs/Header's stamp.

    Raises:
        MessageError: when its part below a second is a second or more.
    """
    seconds, nanoseconds = int(header.stamp.sec), int(header.stamp.nanosec)
    if not 0 <= nanoseconds < NANOSECONDS:
        raise MessageError(
            f"expected a stamp with 0 to {NANOSECONDS - 1} nanoseconds, got {nanoseconds}; fix the driver's clock"
        )
    return seconds * NANOSECONDS + nanoseconds


def check_image_size(width: int, height: int) -> None:
    """Refuses a size that no camera has, before memory is taken for it.

    Raises:
        MessageError: when a side or the number of pixels is too large.
    """
    if max(width, height) > _LARGEST_SIDE_PX or width * height > _LARGEST_IMAGE_PX:
        raise MessageError(
            f"expected an image of at most {_LARGEST_SIDE_PX} pixels a side and {_LARGEST_IMAGE_PX} in all, got "
            f"{width} x {height}; check the driver, or scale the image down"
        )


def make_header(factory: MessageFactory, stamp_ns: int, frame_id: str) -> Any:
    """A std_msgs/Header."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    stamp = factory("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return factory("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def require_fields(message: Any, type_name: str, *names: str) -> None:
    """Checks that a message has the fields that will be read.

    Raises:
        MessageError: when one is missing: the message is of another type.
    """
    missing = [name for name in names if not hasattr(message, name)]
    if missing:
        raise MessageError(
            f"expected a {type_name}, got a {type(message).__name__} without {', '.join(missing)}; "
            "check the type of the topic"
        )


def data_bytes(message: Any) -> ImageArray:
    """The message's `data`, (N,) uint8, sharing its memory.

    Raises:
        MessageError: when `data` is not a buffer.
    """
    try:
        return np.frombuffer(message.data, np.uint8)
    except (TypeError, ValueError, BufferError) as error:
        raise MessageError(
            f"expected bytes in the data of a {type(message).__name__}, got {type(message.data).__name__}; "
            "fill it with bytes, an array.array('B') or a uint8 array"
        ) from error


def flat_bytes(array: np.ndarray[Any, Any]) -> ImageArray:
    """An array's memory, (N,) uint8, a view where the array is contiguous."""
    flat: ImageArray = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    return flat
