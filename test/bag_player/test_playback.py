from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from small_drive import PERIOD_NS, START_NS

from radcam_depth_ros.bag_player import Playback, PlaybackError, PlayOptions, Progress, playback
from radcam_depth_ros.bags import BagReader, BagWriter, factory

SENSORS = {"/camera/image_raw", "/camera/camera_info", "/radar/points", "/ground_truth/depth"}
QUICK = {"rate": 1000.0, "delay_s": 0.0}


@pytest.fixture
def publish(fake_node: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[tuple[str, Any]]]:
    """Plays a bag on the fake node; returns what was published, /clock left out."""

    @contextmanager
    def node(_name: str) -> Iterator[Any]:
        yield fake_node

    monkeypatch.setattr(playback, "ros_node", node)

    def run(path: Path, progress: Any = lambda _: None, **options: Any) -> list[tuple[str, Any]]:
        Playback(path, PlayOptions(**{**QUICK, **options})).run(progress)
        return [(topic, raw) for topic, raw in fake_node.published if topic != "/clock"]

    return run


def fake_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where tf2_msgs is installed."""
    monkeypatch.setattr(playback, "message_class", lambda name: object)
    monkeypatch.setattr("radcam_depth_ros.bag_player.player.message_class", lambda name: object)


def test_all_is_played(write_drive: Callable[..., Path], tmp_path: Path, publish: Any) -> None:
    drive = write_drive(tmp_path / "drive.mcap", without=("/tf_static",))
    told: list[Progress] = []
    played = publish(drive, told.append)
    with BagReader(drive) as reader:
        assert played == [(message.topic, message.raw) for message in reader.messages()]
    assert told[0] == Progress(1, 0.0, told[0].total_s)
    assert told[-1].played_s == pytest.approx(told[0].total_s, abs=1e-6)


def test_a_part_begins_with_what_is_latched(
    write_drive: Callable[..., Path], tmp_path: Path, publish: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_types(monkeypatch)
    drive = write_drive(tmp_path / "drive.mcap")  # /tf_static comes 200 ms before the first image
    played = publish(drive, start_s=0.35, duration_s=0.1)
    assert [topic for topic, _ in played][:1] == ["/tf_static"]
    assert sorted(topic for topic, _ in played[1:]) == sorted(SENSORS)


def test_only_some_topics(write_drive: Callable[..., Path], tmp_path: Path, publish: Any) -> None:
    played = publish(write_drive(tmp_path / "drive.mcap"), topics=("/radar/points",))
    assert {topic for topic, _ in played} == {"/radar/points"}


def test_it_loops_until_it_is_interrupted(write_drive: Callable[..., Path], tmp_path: Path, publish: Any) -> None:
    rounds: list[int] = []

    def stop_in_the_third(progress: Progress) -> None:
        rounds.append(progress.round)
        if progress.round == 3:
            raise KeyboardInterrupt

    drive = write_drive(tmp_path / "drive.mcap", frames=2, without=("/tf_static",))
    with pytest.raises(KeyboardInterrupt):
        publish(drive, stop_in_the_third, loop=True)
    assert [rounds.count(number) for number in (1, 2, 3)] == [8, 8, 1]


@pytest.mark.parametrize(
    ("type_name", "words"),
    [
        ("no_such_msgs/msg/Thing", "no_such_msgs is not installed"),
        ("sensor_msgs/msg/Thing", "has no msg/Thing"),
        ("nonsense", "nonsense"),
    ],
)
def test_it_says_why_a_type_cannot_be_published(type_name: str, words: str) -> None:
    assert words in playback.why_not(type_name)


def test_what_cannot_be_published_is_left_out(
    write_drive: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(playback, "why_not", lambda name: "not installed" if "PointCloud2" in name else "")
    drive = write_drive(tmp_path / "drive.mcap")
    found = Playback(drive, PlayOptions())
    assert found.left_out == ("/radar/points cannot be published: not installed",)
    assert {topic.name for topic in found.topics} == {*SENSORS, "/tf_static"} - {"/radar/points"}
    with pytest.raises(PlaybackError, match=r"nothing of .* can be played; /radar/points cannot"):
        Playback(drive, PlayOptions(topics=("/radar/points",)))


def test_the_quality_of_service_is_the_recorded_one(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    with BagReader(write_drive(tmp_path / "drive.mcap")) as reader:
        played = {topic.name: playback._played(topic) for topic in reader.topics}
    assert (played["/tf_static"].latched, played["/tf_static"].reliable) == (True, True)
    assert (played["/radar/points"].latched, played["/radar/points"].reliable) == (False, True)


def test_a_recorded_clock_gives_way(tmp_path: Path, publish: Any, fake_node: Any) -> None:
    with BagWriter(tmp_path / "clock.mcap") as writer:
        for index in range(3):
            writer.write("/clock", factory("rosgraph_msgs/msg/Clock"), START_NS + index * PERIOD_NS)
            writer.write("/text", factory("std_msgs/msg/String", data="x"), START_NS + index * PERIOD_NS)
    played = publish(tmp_path / "clock.mcap", clock=True)
    assert [topic for topic, _ in played] == ["/text"] * 3
    assert any(topic == "/clock" for topic, _ in fake_node.published)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rate": 0.0}, "rate must be positive"),
        ({"rate": float("nan")}, "rate must be positive"),
        ({"start_s": -1.0}, "start must be 0"),
        ({"delay_s": float("inf")}, "delay must be 0"),
        ({"duration_s": 0.0}, "duration must be a positive"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(PlaybackError, match=words):
        PlayOptions(**options)


def test_a_start_after_the_end_is_refused(write_drive: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(PlaybackError, match=r"0\.6 s long, nothing of it is after 7 s"):
        Playback(write_drive(tmp_path / "drive.mcap"), PlayOptions(start_s=7.0))
