from __future__ import annotations

import json
import os
from dataclasses import replace

import pytest

from benchmarks.soak_figures import Counts, Reading, Round, Soak, read_process

STATUSES = {
    "output": {
        "images": "12",
        "frames out": "4",
        "dropped: unreadable": "1",
        "dropped: duplicate": "1",
        "dropped: no calibration or transform": "0",
        "dropped: overload": "3",
        "dropped: failed": "1",
        "dropped: without radar": "1",
    },
    "pairing": {"images": "10", "waiting": "1", "paired": "8", "backward jumps": "2"},
    "inference": {"frames in": "9"},
}
ROUND = Round(0.0, 5.0, 10, 10, 0, 10, 10, 6, (4, 0, 0))
ROUNDS = tuple(
    replace(ROUND, at_s=6.0 * number, out=6 - number % 2, drops=(4 + number % 2, 0, 0)) for number in range(60)
)
READINGS = tuple(
    Reading(float(second), 500.0 + (50.0 if second < 50 else 0.0), 16, 20, 7.0 + 0.1 * min(second, 60))
    for second in range(360)
)
"""Six minutes, of which the first settles; memory is high while the node begins, and the machine's host is busy."""
LATENCIES = tuple((0.1 * number, 50.0 + number % 10) for number in range(3600))
SOAK = Soak(360.0, 20.0, 40.0, READINGS, LATENCIES, LATENCIES, ROUNDS, 60)


def held(soak: Soak) -> dict[str, bool]:
    return {target.name.split(",")[0].split(" after")[0]: target.is_held for target in soak.targets()}


def test_a_node_that_stays_as_it_is_holds_all_targets() -> None:
    assert SOAK.span_s == 60.0
    assert list(held(SOAK).values()) == [True] * 6
    assert SOAK.settled_and_end("rss_mib") == (500.0, 500.0)


@pytest.mark.parametrize(("leak_mib", "is_held"), [(4.0, True), (7.0, False)])
def test_memory_that_grows_is_told_once_it_settled(leak_mib: float, is_held: bool) -> None:
    growing = tuple(replace(reading, rss_mib=500.0 + leak_mib * reading.at_s / 300) for reading in READINGS)
    soak = replace(SOAK, readings=growing)
    assert held(soak)["memory"] is is_held
    assert soak.targets()[0].value == ("+0.76 %" if is_held else "+1.34 %")
    assert soak.most("rss_mib") == growing[-1].rss_mib


@pytest.mark.parametrize(("factor", "is_held"), [(1.09, True), (1.11, False), (0.89, False)])
def test_latency_of_the_last_span_is_compared_with_the_first(factor: float, is_held: bool) -> None:
    later = tuple((at_s, value * (factor if at_s > 200 else 1.0)) for at_s, value in LATENCIES)
    soak = replace(SOAK, latencies=later)
    assert soak.p99_ms(later) == pytest.approx((59.0, 59.0 * factor))
    assert held(soak)["latency p99"] is is_held


def test_each_span_has_its_latency_and_what_the_host_took() -> None:
    later = tuple((at_s, value * (2 if 60 < at_s < 120 else 1)) for at_s, value in LATENCIES)
    assert SOAK.p99_of_spans_ms(later) == pytest.approx((59.0, 118.0, 59.0, 59.0, 59.0, 59.0))
    assert SOAK.stolen_percent() == pytest.approx((10.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_a_span_without_depth_is_no_number_and_missed_where_it_is_compared() -> None:
    stuck = replace(SOAK, latencies=tuple((at_s, value) for at_s, value in LATENCIES if at_s < 290))
    assert not held(stuck)["latency p99"]
    values = json.loads(json.dumps(stuck.as_json(), allow_nan=False))
    assert values["latency_p99_ms"] == {"first": 59.0, "last": None}
    assert values["latency_p99_of_spans_ms"][-2:] == [59.0, None]


@pytest.mark.parametrize(
    ("change", "missed"),
    [
        ({"pairs": 9}, "pairs in a round"),
        ({"drops": (0, 0, 0)}, "dropped by overload"),
    ],
)
def test_one_round_that_differs_is_told(change: dict[str, object], missed: str) -> None:
    soak = replace(SOAK, rounds=(*ROUNDS, replace(ROUND, **change)))
    assert [name for name, is_held in held(soak).items() if not is_held] == [missed]


@pytest.mark.parametrize(("figure", "name"), [("threads", "threads"), ("files", "file descriptors")])
def test_what_is_left_behind_is_told_and_what_comes_and_goes_is_not(figure: str, name: str) -> None:
    passing = tuple(replace(reading, **{figure: 25 if 150 < reading.at_s < 200 else 20}) for reading in READINGS)
    assert held(replace(SOAK, readings=passing))[name]
    left = tuple(replace(reading, **{figure: 20 + (reading.at_s > 200)}) for reading in READINGS)
    assert not held(replace(SOAK, readings=left))[name]


def test_counts_are_read_from_diagnostics_and_subtracted() -> None:
    counts = Counts.read(STATUSES)
    assert counts == Counts(heard=12, refused=2, waiting=1, with_radar=8, pairs=9, out=4, drops=(3, 1, 1), jumps=2)
    assert not counts.is_settled
    settled = replace(counts, waiting=0, heard=11)
    assert settled.is_settled
    later = replace(settled, heard=21, pairs=19, with_radar=17, out=10, drops=(7, 1, 1))
    assert Round.between(settled, later, 3.0, 5.0, 10) == Round(3.0, 5.0, 10, 10, 0, 9, 10, 6, (4, 0, 0))
    assert Counts.read({"output": {}, "pairing": {}}) is None


def test_what_is_written_is_plain_and_not_long() -> None:
    values = json.loads(json.dumps(SOAK.as_json()))
    assert len(values["readings"]) <= 201
    assert values["readings"][-1]["at_s"] == 359.0
    assert values["rounds"][1]["drops"] == {"overload": 5, "failed": 0, "without radar": 0}
    assert values["latency_p99_ms"] == {"first": 59.0, "last": 59.0}


def test_a_process_is_read() -> None:
    reading = read_process(os.getpid(), 3.0)
    assert reading.at_s == 3.0
    assert reading.rss_mib > 10
    assert reading.threads >= 1
    assert reading.files >= 3
    assert reading.stolen_s >= 0
