from __future__ import annotations

import pytest

from radcam_depth_ros.pairing.timeline import Timeline

MS = 1_000_000
SECOND = 1000 * MS
CAMERA, RADAR = 0, 1


def unwrap(timeline, messages):
    """Messages are (stream, stamp in ms), 10 ms apart; gives the times in ms."""
    times = [timeline.unwrap(stream, stamp * MS, now * 10 * MS) for now, (stream, stamp) in enumerate(messages)]
    return [time / MS for time in times]


def test_stamps_that_go_on_are_left_alone():
    timeline = Timeline(2, 200 * MS)
    messages = [(CAMERA, 0), (RADAR, 30), (CAMERA, 200), (RADAR, -100), (CAMERA, 90_000), (RADAR, 90_010)]
    assert unwrap(timeline, messages) == [stamp for _, stamp in messages]
    assert timeline.resets == 0


@pytest.mark.parametrize("first", [CAMERA, RADAR])
def test_both_sides_of_a_jump_stay_together_and_apart_from_each_other(first):
    second = 1 - first
    before = [(first, 5000), (second, 5010)]
    jump = [(first, 0), (second, 5060), (first, 50), (first, 5050), (second, 5070), (second, 10), (second, 5080)]
    after = [(first, 100), (second, 110)]
    timeline = Timeline(2, 200 * MS)
    times = unwrap(timeline, before + jump + after)
    shift = times[-1] - 110
    assert shift > 3600 * 1000
    for (_, stamp), time in zip(before + jump + after, times, strict=True):
        assert time == stamp + (shift if stamp < 1000 else 0)
    assert timeline.resets == 1


def test_every_jump_counts():
    timeline = Timeline(2, 200 * MS)
    messages = [(stream, stamp) for stamp in range(0, 3000, 100) for stream in (CAMERA, RADAR)] * 4
    times = [timeline.unwrap(stream, stamp * MS, now * 50 * MS) for now, (stream, stamp) in enumerate(messages)]
    assert timeline.resets == 3
    assert times == sorted(times)
    assert times[0::2] == times[1::2]


@pytest.mark.parametrize("wrong", [0, 10**9])
def test_a_stream_comes_back_after_a_wrong_stamp(wrong):
    timeline = Timeline(2, 200 * MS)
    times = unwrap(timeline, [(CAMERA, 50_000), (RADAR, 50_010), (RADAR, wrong), (CAMERA, 50_030), (RADAR, 50_040)])
    assert times[:2] + times[3:] == [50_000, 50_010, 50_030, 50_040]


def test_one_that_is_left_behind_joins_in_the_end():
    timeline = Timeline(2, 200 * MS)
    messages = [(0, RADAR, 10), (3, CAMERA, 5000), (4, CAMERA, 0), (11, CAMERA, 7000), (11, RADAR, 7010)]
    times = [timeline.unwrap(stream, stamp * MS, now * SECOND) for now, stream, stamp in messages]
    assert times[-1] - times[-2] == 10 * MS
    assert timeline.resets == 1
