"""Which echoes a radar reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radcam_depth_ros.simulation import ImagingRadarConfig, RadarConfig
from radcam_depth_ros.simulation.sensors.detections import (
    Cells,
    detected,
    gather,
    level_db,
    with_false_echoes,
    with_spread,
)
from radcam_depth_ros.simulation.sensors.echoes import Echoes
from radcam_depth_ros.simulation.sensors.radar_unit import RadarUnit, draw_imaging_radar, draw_radar

CELLS = Cells(range_m=0.4, azimuth=0.05, elevation=0.05, speed_mps=0.5)


def echoes(count: int, seed: int, section_m2: float = 1.0) -> Echoes:
    rng = np.random.default_rng(seed)
    columns = (
        rng.uniform(1, 60, count),
        rng.uniform(-0.8, 0.8, count),
        rng.uniform(-0.1, 0.1, count),
        section_m2 * rng.exponential(1, count),
        rng.normal(0, 5, count),
        rng.normal(0, 5, count),
    )
    return Echoes(*(column.astype(np.float32) for column in columns))


def unit(**changes: float) -> RadarUnit:
    config = RadarConfig(interference=changes.pop("interference", 0.0))
    quiet = {"missed": 0.0, "clutter": 0.0, "ghosts": 0.0}
    return replace(draw_radar(config, np.random.default_rng(0)), **{**quiet, **changes})


@given(count=st.integers(1, 300), seed=st.integers(0, 2**31))
def test_cells_keep_the_power_and_stay_within_what_they_merge(count: int, seed: int) -> None:
    before = echoes(count, seed)
    after = gather(before, CELLS)
    assert 1 <= len(after) <= count
    assert after.section_m2.sum() == pytest.approx(before.section_m2.sum(), rel=1e-4)
    assert before.range_m.min() - 1e-3 <= after.range_m.min() <= after.range_m.max() <= before.range_m.max() + 1e-3


def test_two_targets_in_a_cell_are_one_return() -> None:
    one = echoes(1, 0)
    close = replace(one, range_m=np.round(one.range_m / 0.4).astype(np.float32) * np.float32(0.4))
    near, far = replace(close, range_m=close.range_m + np.float32(0.1)), replace(close, range_m=close.range_m + 5)
    assert len(gather(close.joined(near), CELLS)) == 1
    assert len(gather(close.joined(far), CELLS)) == 2


def test_cells_widen_to_the_sides() -> None:
    ahead, aside = (
        replace(echoes(200, 0), azimuth=np.linspace(start, start + 0.3, 200, dtype=np.float32)) for start in (0.0, 0.7)
    )
    merged = [len(gather(fan, Cells(1000.0, 0.05, 10.0, 1000.0))) for fan in (ahead, aside)]
    assert merged[0] > merged[1]


def test_what_is_far_must_be_larger_to_be_seen() -> None:
    near, far = (replace(echoes(1, 0), range_m=np.array([range_m], np.float32)) for range_m in (50, 100))
    assert level_db(near, unit())[0] - level_db(far, unit())[0] == pytest.approx(40 * np.log10(2), abs=1e-3)


def test_the_strongest_are_kept() -> None:
    many, radar = echoes(400, 1, 100.0), unit(max_points=50, threshold_dbsm=-40.0)
    kept = detected(many, radar, np.random.default_rng(0))
    assert len(kept) == 50
    assert np.median(level_db(kept, radar)) > np.percentile(level_db(many, radar), 75)


def test_strong_cells_give_more_returns_around_them() -> None:
    radar = draw_imaging_radar(ImagingRadarConfig(), np.random.default_rng(0))
    strong = replace(echoes(20, 2), section_m2=np.full(20, 1e3, np.float32))
    more = with_spread(strong, radar, 5.0, np.random.default_rng(0))
    assert len(more) > 3 * len(strong)
    assert more.section_m2[20:].max() <= 1e3 * 1.001
    assert np.abs(more.range_m[20:, None] - strong.range_m).min(axis=1).max() < 1.0
    assert len(with_spread(strong, radar, 0.0, np.random.default_rng(0))) == len(strong)


def test_interference_is_a_burst_in_some_sweeps() -> None:
    few = echoes(10, 3)
    assert len(with_false_echoes(few, unit(max_points=100), np.random.default_rng(0))) == 10
    bursts = [
        len(with_false_echoes(few, unit(max_points=100, interference=0.5), np.random.default_rng(seed)))
        for seed in range(40)
    ]
    assert 5 < sum(count == 10 for count in bursts) < 35
    assert max(bursts) > 30


def test_doubled_ghosts_move_twice_as_fast() -> None:
    target = replace(
        echoes(60, 4), range_m=np.full(60, 20.0, np.float32), ground_speed_mps=np.full(60, -7.0, np.float32)
    )
    seen = with_false_echoes(target, unit(ghosts=1.0, max_points=1000), np.random.default_rng(0))
    doubled = seen.range_m == 40.0
    assert doubled.sum() > 10
    assert seen.ground_speed_mps[doubled] == pytest.approx(-14.0)
