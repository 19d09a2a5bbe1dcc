from __future__ import annotations

import struct
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.bags import BagError, BagMessage, Header, factory, header_stamp_ns, read_header
from radcam_depth_ros.bags.definitions import MessageType


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999), st.booleans())
def test_the_stamp_is_read_in_both_byte_orders(seconds: int, nanoseconds: int, little: bool) -> None:
    raw = bytes([0, little, 0, 0]) + struct.pack("<iI" if little else ">iI", seconds, nanoseconds) + b"rest"
    assert header_stamp_ns(raw) == seconds * 1_000_000_000 + nanoseconds


@settings(max_examples=50, deadline=None)
@given(
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 999_999_999),
    st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=30),
)
def test_the_header_is_that_of_the_message(seconds: int, nanoseconds: int, frame_id: str) -> None:
    stamp = factory("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    header = factory("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)
    image = factory("sensor_msgs/msg/Image", header=header, height=1)
    raw = MessageType.jazzy("sensor_msgs/msg/Image").serialise(image, "/image")
    assert read_header(bytes(raw)) == Header(seconds * 1_000_000_000 + nanoseconds, frame_id)


def test_the_stamp_is_that_of_recorded_messages(recorded: Sequence[BagMessage]) -> None:
    for message in recorded:
        stamp = message.message.header.stamp
        assert header_stamp_ns(message.raw) == stamp.sec * 1_000_000_000 + stamp.nanosec


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=40))
def test_any_bytes_are_a_header_or_refused(raw: bytes) -> None:
    try:
        header = read_header(raw)
    except BagError:
        return
    assert len(header.frame_id) <= len(raw)


def test_a_frame_that_is_longer_than_the_message_is_refused() -> None:
    with pytest.raises(BagError, match="damaged"):
        read_header(bytes([0, 1, 0, 0]) + struct.pack("<iII", 1, 2, 4_000_000_000) + b"camera")
