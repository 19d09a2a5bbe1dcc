from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from radcam_depth_ros.bag_player import CLOCK_PERIOD_S, MAX_LEAD_NS, PlayedTopic, Player, player
from radcam_depth_ros.bags import BagMessage

IMAGE = "/camera/image_raw"


@pytest.fixture
def topics(recorded: Sequence[BagMessage]) -> list[PlayedTopic]:
    return [PlayedTopic(*topic) for topic in {message.topic: message.type_name for message in recorded}.items()]


def clock_ns(message: Any) -> int:
    return int(message.clock.sec) * 1_000_000_000 + int(message.clock.nanosec)


def always(message: Any) -> bool:
    return True


def test_all_messages_are_played_in_order(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    Player(fake_node, topics, 100).play(recorded, always, 0.1)
    played = [(topic, raw) for topic, raw in fake_node.published if topic != "/clock"]
    assert played == [(message.topic, message.raw) for message in recorded]


def test_the_clock_is_at_each_messages_time_and_runs_on_after_the_last(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    Player(fake_node, topics, 10).play(recorded, always, 0.5)
    now_ns, expected = 0, iter(recorded)
    for topic, message in fake_node.published:
        if topic == "/clock":
            assert clock_ns(message) >= now_ns
            now_ns = clock_ns(message)
        else:
            assert now_ns == next(expected).log_time_ns
    assert now_ns == recorded[-1].log_time_ns + 500_000_000


class Sleeper:
    """The player's clock, which only its own sleep moves."""

    now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_the_rate_is_kept(
    fake_node: Any,
    recorded: Sequence[BagMessage],
    topics: list[PlayedTopic],
    rate: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Sleeper()
    monkeypatch.setattr(player, "time", clock)
    Player(fake_node, topics, rate).play(recorded, always, 0.0)
    recorded_s = (recorded[-1].log_time_ns - recorded[0].log_time_ns) * 1e-9
    assert clock.now_s - Sleeper.now_s == pytest.approx(recorded_s / rate)


def test_a_message_is_held_until_it_may_go_and_the_clock_waits(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    held = [message for message in recorded if message.topic == IMAGE][1]
    released_s = time.monotonic() + 1.0

    def ready(message: Any) -> bool:
        if message is not held or time.monotonic() > released_s:
            return True
        time.sleep(CLOCK_PERIOD_S)
        return False

    Player(fake_node, topics, 1.0).play(recorded, ready, 0.0)
    assert time.monotonic() >= released_s
    before = fake_node.published[: fake_node.published.index((IMAGE, held.raw))]
    times_ns = [clock_ns(message) for topic, message in before if topic == "/clock"]
    assert times_ns == sorted(times_ns)
    assert held.log_time_ns < times_ns[-1] <= held.log_time_ns + MAX_LEAD_NS
    assert {topic for topic, _ in before} == {*(topic.name for topic in topics), "/clock"}


def test_it_says_who_is_not_heard(fake_node: Any, topics: list[PlayedTopic]) -> None:
    player = Player(fake_node, topics, 1.0)
    assert player.unheard() == ()
    fake_node.publishers[IMAGE].subscribers = 0
    fake_node.publishers["/clock"].subscribers = 0
    assert player.unheard() == (IMAGE, "/clock")


def test_without_a_clock_there_is_none(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    Player(fake_node, topics, 100, clock=False).play(recorded)
    assert [topic for topic, _ in fake_node.published] == [message.topic for message in recorded]


def test_what_is_older_than_the_start_comes_at_once(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    start_ns = recorded[-1].log_time_ns
    told: list[int] = []
    Player(fake_node, topics, 1e-3).play(recorded, start_ns=start_ns, played=told.append)
    assert told == [start_ns] * len(recorded)
    assert {clock_ns(message) for topic, message in fake_node.published if topic == "/clock"} == {start_ns}


def test_each_round_begins_where_the_first_did(
    fake_node: Any, recorded: Sequence[BagMessage], topics: list[PlayedTopic]
) -> None:
    player = Player(fake_node, topics, 1000)
    for _ in range(2):
        player.play(recorded)
    times_ns = [clock_ns(message) for topic, message in fake_node.published if topic == "/clock"]
    start_ns = recorded[0].log_time_ns
    assert times_ns[0] == start_ns
    assert times_ns.count(start_ns) == 2
    second = times_ns.index(start_ns, 1)
    assert times_ns == sorted(times_ns[:second]) + sorted(times_ns[second:])


@pytest.mark.parametrize("reliable", [True, False])
@pytest.mark.parametrize("latched", [True, False])
def test_the_quality_of_service_is_the_topics(reliable: bool, latched: bool) -> None:
    qos = PlayedTopic("/a", "sensor_msgs/msg/Image", reliable, latched, 7).qos
    assert (qos.reliability == ReliabilityPolicy.RELIABLE) == reliable
    assert (qos.durability == DurabilityPolicy.TRANSIENT_LOCAL) == latched
    assert qos.depth == 7
