from __future__ import annotations

import pytest

from radcam_depth_ros.node.health import SECOND_NS, Durations, Level, Problems, Rate


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def problems(lines: list[str]) -> Problems:
    return Problems(lambda level, line: lines.append(f"{level.name} {line}"), interval_s=1000)


def test_a_short_problem_is_told_once(problems: Problems) -> None:
    problems.report("camera", Level.ERROR, "it is dark")
    problems.settle("camera")
    assert problems.peek("camera") is None
    assert problems.show("camera") == (Level.ERROR, "it is dark")
    assert problems.show("camera") is None


def test_a_lasting_problem_is_told_until_it_is_settled(problems: Problems) -> None:
    problems.report("camera", Level.ERROR, "it is dark")
    assert problems.show("camera") == problems.show("camera") == (Level.ERROR, "it is dark")
    problems.settle("camera")
    assert problems.show("camera") is None
    assert problems.history("camera") == (("camera: problems", "1"), ("camera: last problem", "it is dark"))


def test_the_first_part_comes_first_and_none_is_forgotten(problems: Problems) -> None:
    problems.report("b", Level.WARN, "second")
    problems.report("a", Level.ERROR, "first")
    assert problems.show("a", "b") == (Level.ERROR, "first")
    problems.settle("a")
    assert problems.show("a", "b") == (Level.WARN, "second")


def test_sentences_that_differ_in_numbers_only_are_logged_once(problems: Problems, lines: list[str]) -> None:
    for number in range(5):
        problems.report("camera", Level.ERROR, f"got {number}.5 bytes")
    problems.report("camera", Level.WARN, "something else")
    problems.report("radar", Level.ERROR, "got 7 bytes")
    problems.report("radar", Level.ERROR, "hidden", quietly=True)
    assert lines == ["ERROR camera: got 0.5 bytes", "WARN camera: something else", "ERROR radar: got 7 bytes"]


def test_the_same_is_logged_again_after_a_while(lines: list[str]) -> None:
    problems = Problems(lambda _, line: lines.append(line), interval_s=0)
    problems.report("camera", Level.ERROR, "dark")
    problems.report("camera", Level.ERROR, "dark")
    assert lines == ["camera: dark"] * 2


def test_it_is_known_what_the_log_has(problems: Problems) -> None:
    problems.report("camera", Level.ERROR, "got 5 bytes", quietly=True)
    assert not problems.is_logged("camera")
    problems.report("camera", Level.ERROR, "got 6 bytes")
    problems.report("camera", Level.ERROR, "got 7 bytes")
    assert problems.is_logged("camera")
    assert not problems.is_logged("radar")


def test_kinds_of_sentences_do_not_pile_up(problems: Problems) -> None:
    for index in range(1000):
        problems.report("camera", Level.ERROR, "x" * index)
    assert len(problems._logged) <= 256


def test_a_rate_looks_at_the_last_seconds() -> None:
    rate = Rate(window_s=5.0)
    assert (rate.hertz(0), rate.age_s(0)) == (0.0, None)
    for step in range(100):
        rate.tick(step * SECOND_NS // 10)
    now_ns = 10 * SECOND_NS
    assert rate.hertz(now_ns) == pytest.approx(10.0)
    assert rate.age_s(now_ns) == pytest.approx(0.1)
    assert rate.hertz(now_ns + 10 * SECOND_NS) == 0.0
    assert rate.count == 100


def test_percentiles_of_durations() -> None:
    durations = Durations(size=100)
    assert durations.percentiles_ms() == ()
    for milliseconds in range(1000):
        durations.add(milliseconds * 1_000_000)
    assert durations.percentiles_ms((0.0, 50.0, 100.0)) == pytest.approx((900.0, 949.5, 999.0))
