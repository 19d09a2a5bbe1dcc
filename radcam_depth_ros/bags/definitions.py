"""Message types: as a bag defines them, within bounds, else as ROS 2 Jazzy does."""

from __future__ import annotations

import functools
import re
from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from radcam_depth_ros.bags.errors import BagError
from radcam_depth_ros.bags.unpacking import MOST_BYTES, mebibytes

RADAR_SCAN = "radar_msgs/msg/RadarScan"
_RADAR_RETURN = "radar_msgs/msg/RadarReturn"
_LACKING = {
    RADAR_SCAN: f"std_msgs/Header header\n{_RADAR_RETURN}[] returns\n",
    _RADAR_RETURN: "".join(
        f"float32 {name}\n" for name in ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
    ),
}
"""Types of ROS 2 Jazzy that rosbags lacks, as radar_msgs 0.2 defines them."""
MOST_SCAN_BYTES = 4 * 1024**2
"""Of a RadarScan, which is read return by return: some 200,000 returns, which take a second."""
MOST_LETTERS = 1024**2
"""Of a definition, with the types that it uses and all comments. The longest of ROS 2 have some 100,000."""
MOST_TYPES = 256
MOST_FIELDS = 2048
"""Of all types of a definition together, as for the two below."""
MOST_CONSTANTS = 2048
MOST_UNROLLED = 4096
"""Elements of arrays of strings or messages with a fixed length: rosbags writes code for each of them."""
MOST_DEPTH = 32
"""Of types in types, and of brackets in an IDL text."""
_MOST_TOKEN_LETTERS = 4096  # of a name, a number, a line of MSG and a string

_IDL_SEPARATOR = "=" * 80 + "\n"
_IDL_STRING = r'"(?:\\"|[^"])*"'  # as rosbags reads it
# Comments, annotations and includes say nothing about the layout, and take most of the time of rosbags' parser.
_IDL_REMARK = re.compile(
    rf"""(?P<string>{_IDL_STRING})
    | // [^\n]* | /\* (?: .*? \*/ | .* ) | (?m:^) [ \t]* \# [^\n]*
    | @ \s* [A-Za-z] [\w:]* (?: \s* \( (?: "(?:[^"\\]|\\.)*" | [^()"] )* \) )?""",
    re.DOTALL | re.VERBOSE,
)
# As rosidl has it: constants are one literal, bounds a number or a name. rosbags evaluates expressions of any size.
_IDL_LITERAL = re.compile(
    r"""[-+]? \s* (?: 0[xX][0-9a-fA-F]+ | \d+ \.? \d* (?:[eE][-+]?\d+)? | \.\d+ (?:[eE][-+]?\d+)? )
    | TRUE | FALSE | '\w' | (?: "" \s* )+""",
    re.VERBOSE,
)


@functools.cache
def jazzy_typestore() -> Any:
    """The message types of ROS 2 Jazzy, as a rosbags type store."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _LACKING.items():
        store.register(get_types_from_msg(text, name))
    return store


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

        A definition that cannot be parsed, or is beyond the bounds, counts as none: one vendor's odd type must not
        close the whole bag.

        Raises:
            BagError: when neither the bag nor Jazzy defines the type.
        """
        store = get_typestore(Stores.EMPTY)
        try:
            types = _parse(name, definition)
            _check_types(types)
            store.register(types)
        except Exception as error:  # a parser of foreign text: whatever it raises means that there is no definition
            if name in jazzy_typestore().fielddefs:
                return cls.jazzy(name)
            reason = str(error) if isinstance(error, _BoundError) else "it does not parse"
            raise BagError(
                f"the bag's definition of {name} cannot be used: {reason}; leave its topics out, or record the bag "
                "again with the package of that type"
            ) from error
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
        if self.name == RADAR_SCAN and len(raw) > MOST_SCAN_BYTES:
            raise BagError(
                f"a scan on {topic} has {mebibytes(len(raw))} of at most {mebibytes(MOST_SCAN_BYTES)}; set a threshold "
                "in the radar's driver, or leave the topic out"
            )
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


class _BoundError(ValueError):
    """A definition beyond a bound; the message is a clause."""


def _check(what: str, count: int, most: int) -> None:
    if count > most:
        raise _BoundError(f"it has {count:,} {what} of at most {most:,}")


def _parse(name: str, definition: MessageDefinition) -> dict[str, Any]:
    text = definition.data
    _check("letters", len(text), MOST_LETTERS)
    types: dict[str, Any] = {}
    if definition.format == MessageDefinitionFormat.MSG:
        types.update(get_types_from_msg(_bounded_msg(text), name))
    elif definition.format == MessageDefinitionFormat.IDL:
        parts = [text]
        if text.startswith(f"{_IDL_SEPARATOR}IDL: "):
            parts = [part.partition("\n")[2] for part in text.split(_IDL_SEPARATOR)[1:]]
        _check("types", len(parts), MOST_TYPES)
        # All are looked at before the first is parsed.
        for part in [_bounded_idl(part) for part in parts]:
            types.update(get_types_from_idl(part))
    return types


def _bounded_msg(text: str) -> str:
    """A MSG text without its comment lines."""
    lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
    _check("letters in a line", max(map(len, lines), default=0), _MOST_TOKEN_LETTERS)
    types = 1 + sum(line.startswith("MSG: ") for line in lines)
    _check("types", types, MOST_TYPES)
    _check("fields and constants", len(lines) - 2 * (types - 1), MOST_FIELDS + MOST_CONSTANTS)
    return "\n".join([*lines, ""])


def _bounded_idl(text: str) -> str:
    """An IDL text without comments and annotations."""
    text = _IDL_REMARK.sub(lambda found: found["string"] or " ", text)
    strings = re.findall(_IDL_STRING, text)
    _check("letters in a string", max(map(len, strings), default=0), _MOST_TOKEN_LETTERS)
    code = re.sub(_IDL_STRING, '""', text)
    _check("letters in a word", max(map(len, re.findall(r"\w+", code)), default=0), _MOST_TOKEN_LETTERS)
    _check("types", len(re.findall(r"\b(?:struct|enum|typedef)\b", code)), MOST_TYPES)
    _check("constants", len(re.findall(r"\bconst\b", code)), MOST_CONSTANTS)
    _check("fields and constants", code.count(";"), MOST_FIELDS + MOST_CONSTANTS)
    depth = deepest = 0
    for bracket in re.findall(r"[{}]", code):
        depth += 1 if bracket == "{" else -1
        deepest = max(deepest, depth)
    _check("levels of brackets", deepest, MOST_DEPTH)
    for value in re.findall(r"=([^;]*)", code):
        if not _IDL_LITERAL.fullmatch(value.strip()):
            raise _BoundError("a constant is an expression, where ROS 2 takes one literal")
    declarations = re.sub(r"=[^;]*", "", code)
    if re.search(r'[-+*/%|^&~()"]|<<', declarations):
        raise _BoundError("a bound is an expression, where ROS 2 takes a number")
    if re.search(r"\bsequence\s*<\s*sequence\b", declarations):
        raise _BoundError("it has a sequence of sequences, which ROS 2 does not have")
    return text


def _check_types(types: dict[str, Any]) -> None:
    """Refuses types that make the code that rosbags writes for them very long, or endless."""
    fields = [field for _, described in types.values() for _, field in described]
    _check("types", len(types), MOST_TYPES)
    _check("fields", len(fields), MOST_FIELDS)
    _check("constants", sum(len(constants) for constants, _ in types.values()), MOST_CONSTANTS)
    unrolled = 0
    for kind, what in fields:
        if kind not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            continue
        (element_kind, element), size = what
        if size < 0:
            raise _BoundError(f"it has an array of {size} elements")
        _check("elements in an array", size, MOST_BYTES)
        if kind == Nodetype.ARRAY and (element_kind == Nodetype.NAME or element[0] == "string"):
            unrolled += size
    _check("elements in arrays of strings or messages", unrolled, MOST_UNROLLED)
    _check_depth(types)


def _check_depth(types: dict[str, Any]) -> None:
    uses = {
        name: {what[0][1] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else what for _, (kind, what) in described}
        & types.keys()
        for name, (_, described) in types.items()
    }
    # Types without other types go first, then those that use these alone, and so on: each round is a level.
    left, level = set(uses), 0
    while left:
        level += 1
        _check("levels of types in types", level, MOST_DEPTH)
        simple = {name for name in left if not uses[name] & left}
        if not simple:
            raise _BoundError(f"the type {min(left)} contains itself")
        left -= simple
