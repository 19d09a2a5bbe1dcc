"""Message types: as a bag defines them, else as ROS 2 Jazzy does."""

from __future__ import annotations

import functools
from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from radcam_depth_ros.bags.errors import BagError

_IDL_SEPARATOR = "=" * 80 + "\n"


@functools.cache
def jazzy_typestore() -> Any:
    """The message types of ROS 2 Jazzy, as a rosbags type store."""
    return get_typestore(Stores.ROS2_JAZZY)


def prepare(name: str) -> None:
    """Makes what reads a type of ROS 2 Jazzy, which otherwise delays its first message."""
    jazzy_typestore().get_msgdef(name)


def deserialise(raw: bytes, name: str) -> Any:
    """The message of a type of ROS 2 Jazzy in CDR bytes, which its arrays are views of.

    Raises:
        BagError: for bytes that do not fit the type.
    """
    try:
        return jazzy_typestore().deserialize_cdr(raw, name)
    except Exception as error:  # damaged bytes make the parser raise nearly anything
        raise BagError(f"{len(raw)} bytes are no {name}: {error}") from error


class MessageType:
    """Layout of one message type.

    Attributes:
        name: For example `sensor_msgs/msg/Image`.
        typestore: The rosbags type store that holds the type.
    """

    def __init__(self, name: str, typestore: Any) -> None:
        self.name = name
        self.typestore = typestore

    @classmethod
    def jazzy(cls, name: str) -> MessageType:
        """A type of ROS 2 Jazzy.

        Raises:
            BagError: when Jazzy has no such type.
        """
        if name not in jazzy_typestore().fielddefs:
            raise BagError(
                f"the message type {name!r} is not one of ROS 2 Jazzy and the bag does not define it; "
                "record the bag as MCAP, which stores the definitions, or leave the topic out"
            )
        return cls(name, jazzy_typestore())

    @classmethod
    def recorded(cls, name: str, definition: MessageDefinition) -> MessageType:
        """The type as the bag defines it, since that is how it was written; else as Jazzy does.

        A definition that cannot be parsed counts as none: one vendor's odd type must not close the whole bag.

        Raises:
            BagError: when neither the bag nor Jazzy defines the type.
        """
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(_parse(name, definition))
        except Exception:  # a parser of foreign text: whatever it raises means that there is no definition
            return cls.jazzy(name)
        return cls(name, store) if name in store.fielddefs else cls.jazzy(name)

    @property
    def has_header(self) -> bool:
        """Whether messages of the type begin with a std_msgs/Header."""
        fields = self.typestore.fielddefs[self.name][1]
        return bool(fields) and fields[0] == ("header", (Nodetype.NAME, "std_msgs/msg/Header"))

    def deserialise(self, raw: bytes, topic: str) -> Any:
        """The message in CDR bytes.

        Raises:
            BagError: for bytes that do not fit the type.
        """
        try:
            return self.typestore.deserialize_cdr(raw, self.name)
        except Exception as error:  # damaged bytes make the parser raise nearly anything
            raise BagError(
                f"a message on {topic} is no {self.name}: {error}; the bag is damaged, record or copy it again"
            ) from error

    def serialise(self, message: object, topic: str) -> memoryview:
        """CDR bytes of a message.

        Raises:
            BagError: for a message that does not fit the type.
        """
        try:
            raw: memoryview = self.typestore.serialize_cdr(message, self.name)
        except Exception as error:  # a wrong field makes the serialiser raise nearly anything
            raise BagError(
                f"the message for {topic} does not fit {self.name}: {type(error).__name__}: {error}; "
                "build it with bags.factory"
            ) from error
        return raw


def _parse(name: str, definition: MessageDefinition) -> Any:
    if definition.format == MessageDefinitionFormat.MSG:
        return get_types_from_msg(definition.data, name)
    if definition.format != MessageDefinitionFormat.IDL:
        return {}
    if not definition.data.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return get_types_from_idl(definition.data)
    types: dict[str, Any] = {}
    for part in definition.data.split(_IDL_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.partition("\n")[2]))
    return types
