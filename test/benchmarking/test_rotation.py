from __future__ import annotations

import numpy as np
import pytest

from radcam_depth_ros.benchmarking import rotation
from radcam_depth_ros.benchmarking.rotation import Schedule, Task, Times, in_rotation


class Clock:
    """Time that passes only when somebody works."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        self.order: list[str] = []
        monkeypatch.setattr(rotation.time, "perf_counter", lambda: self.now_s)

    def task(self, name: str, seconds: float, turn_s: float = 0.0) -> Task:
        def call() -> None:
            self.order.append(name)
            self.now_s += seconds

        return Task(name, call, turn_s)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def test_tasks_take_turns(clock: Clock) -> None:
    seen: list[tuple[int, int]] = []
    tasks = [clock.task("a", 0.001), clock.task("b", 0.002), clock.task("a", 0.003)]
    times = in_rotation(tasks, Schedule(3), "cpu", lambda done, total: seen.append((done, total)))
    assert clock.order == ["a", "b", "a"] * 3
    np.testing.assert_allclose(times.ms, [[1.0, 2.0, 3.0]] * 3)
    np.testing.assert_allclose(times.of("a"), [4.0] * 3)
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_what_is_slow_gets_fewer_rounds_but_two(clock: Clock) -> None:
    assert len(in_rotation([clock.task("a", 20.0)], Schedule(30, 90.0), "cpu", lambda *_: None).ms) == 4
    assert len(in_rotation([clock.task("a", 200.0)], Schedule(30, 90.0), "cpu", lambda *_: None).ms) == 2
    assert len(in_rotation([clock.task("a", 200.0)], Schedule(1, 90.0), "cpu", lambda *_: None).ms) == 1


def test_a_turn_lasts_and_its_median_counts(clock: Clock) -> None:
    times = in_rotation(
        [clock.task("fast", 0.01, 0.095), clock.task("slow", 1.0, 0.1)], Schedule(2), "cpu", lambda *_: None
    )
    assert clock.order == ([*["fast"] * 10, "slow"]) * 2
    np.testing.assert_allclose(times.ms, [[10.0, 1000.0]] * 2)


def test_an_unknown_task_took_no_time() -> None:
    assert Times(("a",), np.ones((4, 1))).of("b").tolist() == [0.0] * 4
