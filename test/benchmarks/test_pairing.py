"""The benchmark of pairing: every image of its scenarios has its nearest sweep."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.pairing import SCENARIOS, measure


@pytest.mark.parametrize("name", SCENARIOS)
def test_each_scenario_pairs_what_can_be_paired(name: str) -> None:
    scenario = SCENARIOS[name]
    row = measure(replace(scenario, seconds=min(scenario.seconds, 20.0)), seed=1)
    assert row["paired"] >= 0.99 * row["images"]
    assert row["nearest"] >= 0.99 * row["images"]
    assert 0 <= row["wait_mean_ms"] <= row["wait_p99_ms"] <= 120
