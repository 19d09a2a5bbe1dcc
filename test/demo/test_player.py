from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import pytest

from demo.player import CLOCK_PERIOD_S, MAX_LEAD_NS, Player
from radcam_depth_ros.bags import BagMessage

IMAGE = "/camera/image_raw"


@pytest.fixture
def types(recorded: Sequence[BagMessage]) -> dict[str, str]:
    return {message.topic: message.type_name for message in recorded}


def clock_ns(message: Any) -> int:
    return int(message.clock.sec) * 1_000_000_000 + int(message.clock.nanosec)


def always(message: Any) -> bool:
    return True


def test_all_messages_are_played_in_order(
    fake_node: Any, recorded: Sequence[BagMessage], types: dict[str, str]
) -> None:
    Player(fake_node, types, 100).play(recorded, always, 0.1)
    played = [(topic, raw) for topic, raw in fake_node.published if topic != "/clock"]
    assert played == [(message.topic, message.raw) for message in recorded]


def test_the_clock_is_at_each_messages_time_and_runs_on_after_the_last(
    fake_node: Any, recorded: Sequence[BagMessage], types: dict[str, str]
) -> None:
    Player(fake_node, types, 10).play(recorded, always, 0.5)
    now_ns, expected = 0, iter(recorded)
    for topic, message in fake_node.published:
        if topic == "/clock":
            assert clock_ns(message) >= now_ns
            now_ns = clock_ns(message)
        else:
            assert now_ns == next(expected).log_time_ns
    assert now_ns == recorded[-1].log_time_ns + 500_000_000


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_the_rate_is_kept(fake_node: Any, recorded: Sequence[BagMessage], types: dict[str, str], rate: float) -> None:
    began_s = time.monotonic()
    Player(fake_node, types, rate).play(recorded, always, 0.0)
    recorded_s = (recorded[-1].log_time_ns - recorded[0].log_time_ns) * 1e-9
    assert recorded_s / rate <= time.monotonic() - began_s < recorded_s / rate + 0.5


def test_a_message_is_held_until_it_may_go_and_the_clock_waits(
    fake_node: Any, recorded: Sequence[BagMessage], types: dict[str, str]
) -> None:
    held = [message for message in recorded if message.topic == IMAGE][1]
    released_s = time.monotonic() + 1.0

    def ready(message: Any) -> bool:
        if message is not held or time.monotonic() > released_s:
            return True
        time.sleep(CLOCK_PERIOD_S)
        return False

    Player(fake_node, types, 1.0).play(recorded, ready, 0.0)
    assert time.monotonic() >= released_s
    before = fake_node.published[: fake_node.published.index((IMAGE, held.raw))]
    times_ns = [clock_ns(message) for topic, message in before if topic == "/clock"]
    assert times_ns == sorted(times_ns)
    assert held.log_time_ns < times_ns[-1] <= held.log_time_ns + MAX_LEAD_NS
    assert {topic for topic, _ in before} == {*types, "/clock"}


def test_it_says_who_is_not_heard(fake_node: Any, types: dict[str, str]) -> None:
    player = Player(fake_node, types, 1.0)
    assert player.unheard() == ()
    fake_node.publishers[IMAGE].subscribers = 0
    fake_node.publishers["/clock"].subscribers = 0
    assert player.unheard() == (IMAGE, "/clock")
