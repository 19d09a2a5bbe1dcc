from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from bag_bombs import chunk_record, message_record, schema_record, write_mcap
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from radcam_depth_ros.bags import BagError, BagReader, BagWriter
from radcam_depth_ros.bags.definitions import MessageType

NAME = "acme_msgs/msg/Detection"
SEPARATOR = "=" * 80 + "\n"
BEGIN, END = "module acme_msgs { module msg {", "}; };"


def recorded(text: str, kind: str = "MSG", name: str = NAME) -> MessageType:
    return MessageType.recorded(name, MessageDefinition(MessageDefinitionFormat[kind], text))


def idl(fields: str = "uint8 a;", constants: str = "") -> str:
    constants = f"module Detection_Constants {{ {constants} }};" if constants else ""
    return f"{BEGIN} {constants} struct Detection {{ {fields} }}; {END}"


def chain(levels: int) -> str:
    types = [f"{SEPARATOR}MSG: acme_msgs/L{level}\nL{level + 1} next\n" for level in range(levels)]
    return f"L0 next\n{''.join(types)}{SEPARATOR}MSG: acme_msgs/L{levels}\nuint8 a\n"


def nested(levels: int) -> str:
    return "module a {" * levels + "struct B { uint8 a; };" + "};" * levels


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        ("MSG", "#" * 1_048_577, "1,048,577 letters of at most 1,048,576"),
        ("MSG", "uint8 A=" + "1" * 4089, "4,097 letters in a line"),
        ("MSG", "".join(f"uint8 a{index}\n" for index in range(4097)), "4,097 fields and constants"),
        ("MSG", "".join(f"uint8 a{index}\n" for index in range(2049)), "2,049 fields"),
        ("MSG", "uint8 a\n" + f"{SEPARATOR}MSG: acme_msgs/A\nuint8 a\n" * 256, "257 types of at most 256"),
        ("MSG", "string[1000000000] names\n", "1,000,000,000 elements in an array"),
        ("MSG", "uint8[1000000000] data\n", "1,000,000,000 elements in an array"),
        ("MSG", "uint8[-1] data\n", "an array of -1 elements"),
        ("MSG", "string[4000] first\nstring[97] second\n", "4,097 elements in arrays of strings or messages"),
        ("MSG", chain(32), "33 levels of types in types"),
        ("MSG", "Detection[] inner\n", f"the type {NAME} contains itself"),
        ("MSG", "uint8 a b c\nunreadable {\n", "it does not parse"),
        ("IDL", " " * 1_048_577, "1,048,577 letters"),
        ("IDL", idl(constants="const uint32 A = 1 << 100000000000;"), "a constant is an expression"),
        ("IDL", idl(constants="const uint32 A = 9 * 9;"), "a constant is an expression"),
        ("IDL", idl(constants=f"const uint32 A = {'(' * 40}1{')' * 40};"), "a constant is an expression"),
        ("IDL", idl(constants="const string A = B;"), "a constant is an expression"),
        ("IDL", idl(constants="const uint32 A = " + "9" * 5000 + ";"), "5,000 letters in a word"),
        ("IDL", idl(constants=f'const string A = "{"a" * 5000}";'), "5,002 letters in a string"),
        ("IDL", idl(constants="const uint8 A = 1;" * 2049), "2,049 constants"),
        ("IDL", idl("uint8 a;" * 4097), "fields and constants of at most 4,096"),
        ("IDL", idl("uint8 " + ",".join(f"a{index}" for index in range(2049)) + ";"), "2,049 fields"),
        ("IDL", idl("uint8 a[1000000000];"), "1,000,000,000 elements in an array"),
        ("IDL", idl("uint8 a[1 << 64];"), "a bound is an expression"),
        ("IDL", idl("string a[5000];"), "5,000 elements in arrays of strings"),
        ("IDL", idl("sequence<" * 30 + "uint8" + ">" * 30 + " a;"), "sequence of sequences"),
        ("IDL", nested(33), "34 levels of brackets of at most 32"),
        ("IDL", "".join(f"struct A{index} {{ uint8 a; }};" for index in range(257)), "257 types"),
        ("IDL", f"{SEPARATOR}IDL: a/msg/A\n" * 257, "257 types"),
        ("IDL", idl("Detection a;"), "contains itself"),
        ("IDL", idl() + '@a("' + '\\"' * 2000, "a bound is an expression"),
        ("IDL", "typedef A B; typedef B A;" + idl("A a;"), "it does not parse"),
    ],
    ids=itertools.count(),
)
def test_a_definition_beyond_the_bounds_is_refused_at_once(kind, text, said):
    begin = time.process_time()
    with pytest.raises(BagError, match=f"definition of {NAME} cannot be used") as caught:
        recorded(text, kind)
    assert time.process_time() - begin < 20
    assert said in caught.value.args[0]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["MSG", "IDL"])
def test_a_type_of_jazzy_is_read_whatever_the_bag_says_of_it(kind):
    kept = recorded("=" * 2_000_000, kind, "std_msgs/msg/Header")
    assert [name for name, _ in kept.typestore.fielddefs[kept.name][1]] == ["stamp", "frame_id"]


def test_definitions_of_idl_are_read_as_rosidl_writes_them():
    text = f"""{SEPARATOR}IDL: {NAME}
// generated from a .msg file /* by nobody
#include "acme_msgs/msg/Cell.idl"
/* a comment with "half a string */
module acme_msgs {{ module msg {{
  typedef double double__36[36];
  module Detection_Constants {{
    @verbatim (language="comment", text="A \\"quoted\\" word (in brackets)" "\\n" "and // no comment")
    const uint8 CAR = 1;
    const int32 LOW = -5;
    const double HALF = 5.0e-1;
    const boolean YES = TRUE;
    const string WORD = "a // b" " /* c";
  }};
  @verbatim (language="comment", text="What the radar sees.")
  struct Detection {{
    @unit (value="m") @default (value=0.5)
    float range;
    sequence<string<22>, 10> names;
    double__36 covariance;
    acme_msgs::msg::Cell cell;
  }};
}}; }};
{SEPARATOR}IDL: acme_msgs/msg/Cell
module acme_msgs {{ module msg {{ struct Cell {{ uint8 value; }}; }}; }};
"""
    kept = recorded(text, "IDL")
    constants, fields = kept.typestore.fielddefs[NAME]
    assert {name: value for name, _, value in constants} == {
        "CAR": 1,
        "LOW": -5,
        "HALF": 0.5,
        "YES": True,
        "WORD": "a // b /* c",
    }
    assert [name for name, _ in fields] == ["range", "names", "covariance", "cell"]
    raw = kept.serialise(
        kept.typestore.types[NAME](0.5, ["a"], np.zeros(36), kept.typestore.types["acme_msgs/msg/Cell"](7)),
        "/radar",
    )
    assert kept.deserialise(bytes(raw), "/radar").cell.value == 7


def test_definitions_of_msg_are_read_within_the_bounds():
    text = "# a comment\n\nuint8 A=1 # one\nstring B='# b'\n  # more\nCell[800] cells\n"
    text += f"{SEPARATOR}MSG: acme_msgs/Cell\nuint8 a\n"
    kept = recorded(text)
    constants, fields = kept.typestore.fielddefs[NAME]
    assert [(name, value) for name, _, value in constants] == [("A", 1), ("B", "# b")]
    assert [name for name, _ in fields] == ["cells"]
    assert recorded(chain(30)).name == NAME


def test_a_definition_that_is_refused_closes_its_topic_alone(tmp_path):
    content = message_record(bytes(8))
    schema = schema_record(NAME, "string[1000000000] names\n")
    path = write_mcap(tmp_path / "drive.mcap", [chunk_record(content, "", len(content))], schema=schema)
    with BagReader(path) as bag:
        (item,) = bag.messages()
        assert item.raw == bytes(8)
        for _ in range(2):
            with pytest.raises(BagError, match=r"1,000,000,000 elements .*; leave its topics out"):
                _ = item.message


def test_a_definition_that_lacks_a_type_is_not_copied(tmp_path):
    content = message_record(bytes(8))
    schema = schema_record(NAME, "acme_msgs/Missing part\n")
    path = write_mcap(tmp_path / "drive.mcap", [chunk_record(content, "", len(content))], schema=schema)
    with BagReader(path) as bag:
        (item,) = bag.messages()
        with (
            BagWriter(tmp_path / "copy.mcap") as copy,
            pytest.raises(BagError, match=r"the type of /camera/image_raw, is not whole"),
        ):
            copy.copy(item)
