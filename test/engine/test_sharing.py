"""The number of threads beside other work, on a simulated computer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radcam_depth_ros.engine.load import Load
from radcam_depth_ros.engine.sharing import LEAST_S, LONGEST_HOLD_S, WAITED_SHARE, WINDOW_S, ThreadBudget

WORK_S = 0.1
"""Core seconds of a frame."""


@dataclass
class Computer:
    """Shares its cores fairly between the threads of a network and others, which always compute.

    Attributes:
        cores: How many there are.
        others: Busy threads of other processes.
        load: What it tells.
    """

    cores: int = 2
    others: int = 0
    load: Load = field(default_factory=lambda: Load(100.0, 50.0, 20.0, 1.0))

    def read(self) -> Load:
        return self.load

    def pass_time(self, seconds: float, threads: int = 0) -> None:
        """Passes time in which so many threads of this process compute or wait for a core."""
        share = min(1.0, self.cores / max(1, threads + self.others))
        now = self.load
        self.load = Load(
            now.at_s + seconds,
            now.busy_s + seconds * share * (threads + self.others),
            now.own_s + seconds * share * threads,
            now.waited_s + seconds * (1.0 - share) * threads,
        )

    def run_frame(self, budget: ThreadBudget) -> int:
        """Runs a frame, which takes longer the fewer cores it gets; the number of its threads."""
        threads = budget.begin()
        crowd = max(1.0, (threads + self.others) / self.cores)
        # Of threads that wait for each other, one without a core holds up all.
        self.pass_time(WORK_S / threads * (crowd if threads == 1 else crowd**3), threads)
        budget.end()
        return threads

    def wait_until(self, threads: int, budget: ThreadBudget, longest_s: float = 30.0) -> float:
        """Runs frames until one takes so many threads; the seconds until it began."""
        began_s = self.load.at_s
        while self.load.at_s < began_s + longest_s:
            at_s = self.load.at_s
            if self.run_frame(budget) == threads:
                return at_s - began_s
        raise AssertionError(f"no frame with {threads} threads within {longest_s} s")


def budget_of(computer: Computer) -> ThreadBudget:
    return ThreadBudget(computer.cores, computer.cores, computer.read)


@pytest.mark.parametrize("cores", [1, 2, 8])
def test_on_an_idle_computer_all_are_taken(cores: int) -> None:
    computer = Computer(cores)
    budget = budget_of(computer)
    assert {computer.run_frame(budget) for _ in range(200)} == {cores}


def test_one_disturbed_frame_changes_nothing() -> None:
    computer = Computer()
    budget = budget_of(computer)
    for _ in range(5):
        computer.run_frame(budget)
        budget.begin()
        computer.others = 4
        computer.pass_time(0.8 * LEAST_S, 2)
        computer.others = 0
        budget.end()
    assert computer.run_frame(budget) == 2


def test_own_threads_that_wait_for_each_other_change_nothing() -> None:
    """The cores are busy with this process itself, such as with the decoding of images."""
    computer = Computer()
    budget = budget_of(computer)
    for _ in range(20):
        budget.begin()
        computer.pass_time(0.1, 5)
        budget.end()
    assert budget.begin() == 2


@pytest.mark.parametrize("others", [1, 2, 4])
def test_beside_busy_processes_it_is_one_of_two_within_two_frames(others: int) -> None:
    computer = Computer()
    budget = budget_of(computer)
    computer.wait_until(2, budget)
    computer.others = others
    taken = [computer.run_frame(budget) for _ in range(100)]
    assert taken[0] == 2
    assert set(taken[2:]) == {1}


@pytest.mark.parametrize(("others", "left"), [(0, 8), (1, 7), (3, 5), (4, 4), (8, 1), (20, 1)])
def test_of_eight_cores_it_takes_those_that_are_free(others: int, left: int) -> None:
    computer = Computer(8, others)
    budget = budget_of(computer)
    taken = [computer.run_frame(budget) for _ in range(200)]
    assert set(taken[20:]) == {left}
    assert taken[:20] == sorted(taken[:20], reverse=True)


def test_it_takes_a_core_that_some_of_the_others_leave() -> None:
    computer = Computer(8, 5)
    budget = budget_of(computer)
    computer.wait_until(3, budget)
    computer.others = 2
    computer.wait_until(6, budget)


def test_it_comes_back_after_a_calm_window_and_not_before() -> None:
    computer = Computer(others=1)
    budget = budget_of(computer)
    computer.wait_until(1, budget)
    for _ in range(50):
        computer.run_frame(budget)
    computer.others = 0
    # The window that has begun still has the other in it.
    assert WINDOW_S <= computer.wait_until(2, budget) <= 2 * WINDOW_S + 2 * WORK_S


def test_a_camera_that_pauses_comes_back_at_once() -> None:
    computer = Computer(others=1)
    budget = budget_of(computer)
    computer.wait_until(1, budget)
    computer.others = 0
    computer.pass_time(60.0)
    assert computer.run_frame(budget) == 2


def flap(computer: Computer, budget: ThreadBudget, most: int) -> float:
    """A load that comes as soon as all threads are taken, and goes as soon as they are fewer; seconds until all again.

    They count from the moment at which the threads last became fewer.
    """
    computer.others = 2
    while budget.threads > most - 2:
        computer.run_frame(budget)
    computer.others = 0
    return computer.wait_until(most, budget)


@pytest.mark.parametrize("cores", [3, 8])
def test_flapping_load_doubles_the_hold_up_to_the_longest(cores: int) -> None:
    computer = Computer(cores)
    budget = budget_of(computer)
    held_s = [flap(computer, budget, cores) for _ in range(7)]
    expected = [min(WINDOW_S * 2**index, LONGEST_HOLD_S) for index in range(7)]
    assert expected[-2:] == [LONGEST_HOLD_S] * 2
    for held, least in zip(held_s, expected, strict=True):
        assert least - 1e-6 <= held <= least + WINDOW_S + WORK_S


def test_after_a_long_calm_the_hold_is_short_again() -> None:
    computer = Computer(3)
    budget = budget_of(computer)
    for _ in range(5):
        flap(computer, budget, 3)
    began_s = computer.load.at_s
    while computer.load.at_s < began_s + LONGEST_HOLD_S:
        assert computer.run_frame(budget) == 3
    assert flap(computer, budget, 3) <= 2 * WINDOW_S + WORK_S


@pytest.mark.parametrize("untold", ["busy_s", "waited_s"])
def test_where_the_system_does_not_tell_all_threads_are_taken(untold: str) -> None:
    computer = Computer(others=4, load=replace(Computer().load, **{untold: math.nan}))
    budget = budget_of(computer)
    assert {computer.run_frame(budget) for _ in range(50)} == {2}


def test_waiting_below_the_share_changes_nothing() -> None:
    """Others that run beside without taking a core away, such as with a lower priority."""
    computer = Computer(others=2)
    budget = budget_of(computer)
    for _ in range(50):
        budget.begin()
        now = computer.load
        computer.load = Load(now.at_s + 0.1, now.busy_s + 0.2, now.own_s + 0.1, now.waited_s + 0.09 * WAITED_SHARE)
        budget.end()
    assert budget.begin() == 2


steps = st.floats(0.0, 20.0) | st.just(math.nan)
readings = st.builds(Load, st.floats(0.0, 10.0), steps, steps, st.floats(-5.0, 20.0) | st.just(math.nan))


@given(st.integers(1, 9), st.integers(1, 9), st.lists(readings, max_size=40))
def test_threads_are_at_least_one_and_at_most_the_most(most: int, cores: int, passed: list[Load]) -> None:
    now = Load(0.0, 0.0, 0.0, 0.0)
    budget = ThreadBudget(most, cores, lambda: now)
    for index, step in enumerate(passed):
        now = Load(now.at_s + step.at_s, now.busy_s + step.busy_s, now.own_s + step.own_s, now.waited_s + step.waited_s)
        if index % 2:
            budget.end()
        else:
            assert budget.begin() == budget.threads
        assert 1 <= budget.threads <= most
