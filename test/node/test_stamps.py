from __future__ import annotations

import random

import pytest

from radcam_depth_ros.node.health import SECOND_NS, Level, Status, summary
from radcam_depth_ros.node.latency import LATENCY_PARTS, FrameTimes
from radcam_depth_ros.node.stamps import LostMessages, SensorStamps, StampOffset

MS = 1_000_000


def test_missing_messages_are_counted_by_the_gaps_that_they_leave() -> None:
    stamps, rng = SensorStamps(), random.Random(3)
    assert stamps.missing_share() is None
    kept = [step for step in range(120) if rng.random() > 0.3]
    for step in kept:
        stamps.add(step * 100 * MS + rng.randint(-5, 5) * MS, 0)
    assert stamps.missing_share() == pytest.approx(1 - len(kept) / 120, abs=0.02)


def test_what_was_published_and_never_came_is_counted() -> None:
    lost = LostMessages()
    for number in (7, 8, 11, 12, 20):
        lost.add(number, lambda: 1)
    assert lost.count == 2 + 7
    for number in (1, 2, 4):  # a publisher that began anew
        lost.add(number, lambda: 1)
    assert lost.count == 10


@pytest.mark.parametrize(("number", "publishers"), [(None, 1), (0, 1), (90, 2), (90, 0)])
def test_numbers_that_tell_nothing_count_nothing(number: int | None, publishers: int) -> None:
    lost = LostMessages()
    lost.add(3, lambda: 1)
    lost.add(number, lambda: publishers)
    lost.add(120, lambda: 1)
    assert lost.count == 0


def test_neither_order_nor_duplicates_nor_a_pause_are_missing_messages() -> None:
    stamps = SensorStamps()
    for step in [1, 0, 3, 3, 2, 5, 4, 1000, 1001, 1002, 1004, 1003]:
        stamps.add(step * 100 * MS, 0)
    assert stamps.missing_share() == 0.0


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_an_offset_is_that_of_messages_that_come_together_at_any_speed_of_a_bag(rate: float) -> None:
    image, offset, rng = SensorStamps(), StampOffset(), random.Random(1)
    for step in range(60):
        stamp_ns = 50 * SECOND_NS + step * 33 * MS
        arrived_ns = round(step * 33 * MS / rate) + rng.randint(0, 5) * MS
        image.add(stamp_ns, arrived_ns)
        if step % 3 == 0:
            offset.add(stamp_ns - 500 * MS, arrived_ns + 2 * MS, image)
    assert offset.seconds() == pytest.approx(-0.5, abs=0.02)
    assert offset.apart_s(0.2) == pytest.approx(-0.5, abs=0.02)
    assert offset.apart_s(0.2, added_s=0.5) is None


def test_arrivals_that_vary_by_as_much_tell_no_offset() -> None:
    image, offset, rng = SensorStamps(), StampOffset(), random.Random(1)
    for step in range(60):
        image.add(step * 100 * MS, step * 100 * MS)
        offset.add(step * 100 * MS, step * 100 * MS + rng.randint(0, 900) * MS, image)
    assert offset.apart_s(0.2) is None


def test_an_image_of_long_ago_is_not_compared_with() -> None:
    image, offset = SensorStamps(), StampOffset()
    image.add(0, 0)
    for step in range(20, 40):
        offset.add(step * 100 * MS, step * 100 * MS, image)
    assert offset.seconds() is None


def test_the_parts_of_a_frame_s_time_make_up_the_whole() -> None:
    durations = FrameTimes(10, 11, 13, 17, 25).durations_ns()
    assert tuple(durations[part] for part in LATENCY_PARTS) == (15, 1, 2, 4, 8)


@pytest.mark.parametrize(
    ("levels", "worst"),
    [
        ((Level.OK, Level.OK), Level.OK),
        ((Level.OK, Level.STALE), Level.STALE),
        ((Level.STALE, Level.WARN), Level.WARN),
        ((Level.WARN, Level.ERROR), Level.ERROR),
        ((Level.ERROR, Level.STALE), Level.ERROR),
    ],
)
def test_the_whole_is_as_bad_as_its_worst_part(levels: tuple[Level, Level], worst: Level) -> None:
    parts = tuple(Status(name, level, f"{name} says so") for name, level in zip("ab", levels, strict=True))
    whole = summary(parts)
    assert (whole.name, whole.level) == ("health", worst)
    assert whole.message.startswith(worst.name)
    assert whole.values == tuple((part.name, part.level.name) for part in parts)
