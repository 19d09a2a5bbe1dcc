from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from demo.recorder import Recorder
from radcam_depth_ros.bags import BagMessage, BagReader, header_stamp_ns

DEPTH, INFO, RADAR = "/ground_truth/depth", "/camera/camera_info", "/radar/points"


@pytest.fixture
def types(recorded: Sequence[BagMessage]) -> dict[str, str]:
    return {message.topic: message.type_name for message in recorded}


def test_what_comes_is_written_with_its_stamp(
    fake_node: Any, recorded: Sequence[BagMessage], types: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "out.mcap"
    outputs = {topic: types[topic] for topic in (DEPTH, INFO)}
    stamps_ns = [message.log_time_ns for message in recorded if message.topic == DEPTH]
    with Recorder(fake_node, outputs, {RADAR: types[RADAR]}, path) as recorder:
        assert recorder.unpublished() == (DEPTH, INFO, RADAR)
        for message in recorded:
            if message.topic == INFO:
                assert not recorder.wait_for(message.log_time_ns, 0.0)
            if message.topic in fake_node.callbacks:
                fake_node.callbacks[message.topic](message.raw)
            if message.topic == DEPTH:
                assert recorder.wait_for(message.log_time_ns, 0.0)
        assert sorted(recorder.arrivals_s(DEPTH)) == stamps_ns
        assert not path.exists()
    with BagReader(path) as reader:
        assert {topic.name: topic.count for topic in reader.topics} == {DEPTH: 3, INFO: 3, RADAR: 3}
        assert [message.log_time_ns for message in reader.messages([DEPTH])] == stamps_ns
        assert all(header_stamp_ns(message.raw) == message.log_time_ns for message in reader.messages())


def test_after_an_error_there_is_no_bag(fake_node: Any, types: dict[str, str], tmp_path: Path) -> None:
    with (
        pytest.raises(ZeroDivisionError),
        Recorder(fake_node, {DEPTH: types[DEPTH]}, {}, tmp_path / "out.mcap"),
    ):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_publishers_are_known_by_the_graph(fake_node: Any, types: dict[str, str], tmp_path: Path) -> None:
    recorder = Recorder(fake_node, {DEPTH: types[DEPTH], INFO: types[INFO]}, {}, tmp_path / "out.mcap")
    fake_node.remote_publishers = {DEPTH: 1}
    assert recorder.unpublished() == (INFO,)
