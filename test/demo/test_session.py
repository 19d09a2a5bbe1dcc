from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from demo import session as under_way
from demo.process import DemoError
from demo.session import Session
from radcam_depth_ros.bags import BagMessage

IMAGE, DEPTH = "/camera/image_raw", "/depth/image_rect"


class FakeProcess:
    last_lines = "the end of the log"

    def check(self) -> None:
        pass


class FakeRecorder:
    """Has the depth of the stamps that it is told."""

    def __init__(self) -> None:
        self.arrived: set[int] = set()

    def wait_for(self, stamp_ns: int, timeout_s: float) -> bool:
        return stamp_ns in self.arrived

    def arrivals_s(self, topic: str) -> dict[int, float]:
        return dict.fromkeys(self.arrived, 0.0)


@pytest.fixture
def recorder() -> FakeRecorder:
    return FakeRecorder()


def make_session(recorder: Any, waits: bool) -> Session:
    process: Any = FakeProcess()
    return Session(process, recorder, IMAGE, DEPTH, waits)


def images(recorded: Sequence[BagMessage]) -> list[BagMessage]:
    return [message for message in recorded if message.topic == IMAGE]


def test_an_image_waits_for_the_depth_of_the_one_before(recorder: FakeRecorder, recorded: Sequence[BagMessage]) -> None:
    session = make_session(recorder, waits=True)
    first, second, _ = images(recorded)
    assert session.ready(first)
    assert not session.ready(second)
    recorder.arrived.add(first.log_time_ns)
    assert session.ready(second)
    assert list(session.sent_s) == [first.log_time_ns, second.log_time_ns]


def test_other_messages_do_not_wait(recorder: FakeRecorder, recorded: Sequence[BagMessage]) -> None:
    session = make_session(recorder, waits=True)
    assert session.ready(images(recorded)[0])
    assert all(session.ready(message) for message in recorded if message.topic != IMAGE)


def test_at_a_given_rate_nothing_waits(recorder: FakeRecorder, recorded: Sequence[BagMessage]) -> None:
    session = make_session(recorder, waits=False)
    advanced: list[int] = []
    session.advance = lambda: advanced.append(1)
    assert all(session.ready(message) for message in recorded)
    assert len(session.sent_s) == len(advanced) == 3


def test_a_node_that_gives_nothing_is_given_up(
    recorder: FakeRecorder, recorded: Sequence[BagMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(under_way, "FRAME_TIMEOUT_S", 0.0)
    monkeypatch.setattr(under_way, "MISSES_ALLOWED", 1)
    session = make_session(recorder, waits=True)
    first, second, third = images(recorded)
    assert session.ready(first)
    assert session.ready(second)
    with pytest.raises(DemoError, match=r"(?s)no depth image came for 2 images.*the end of the log"):
        session.ready(third)


def test_a_miss_between_others_is_passed_over(
    recorder: FakeRecorder, recorded: Sequence[BagMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(under_way, "FRAME_TIMEOUT_S", 0.0)
    session = make_session(recorder, waits=True)
    for message in images(recorded):
        assert session.ready(message)
    recorder.arrived.add(images(recorded)[-1].log_time_ns)
    session.finish()


def test_no_depth_at_all_is_an_error_at_the_end(
    recorder: FakeRecorder, recorded: Sequence[BagMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(under_way, "FRAME_TIMEOUT_S", 0.0)
    session = make_session(recorder, waits=False)
    assert session.ready(images(recorded)[0])
    with pytest.raises(DemoError, match="no depth image at all"):
        session.finish()
