from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.inspection.timing import nearest_offsets_ns, timing_of

TIMES = st.lists(st.integers(0, 10**12), min_size=1, max_size=30)


@settings(max_examples=100, deadline=None)
@given(TIMES, TIMES)
def test_no_sweep_is_nearer_than_the_nearest(images: list[int], sweeps: list[int]) -> None:
    offsets = nearest_offsets_ns(images, sweeps)
    for image, offset in zip(images, offsets.tolist(), strict=True):
        assert image + offset in sweeps
        assert abs(offset) == min(abs(sweep - image) for sweep in sweeps)


@settings(max_examples=100, deadline=None)
@given(TIMES)
def test_any_times_have_a_timing(times: list[int]) -> None:
    timing = timing_of(times)
    if len(set(times)) < 2:
        assert timing.hz is None
        return
    assert timing.hz is not None
    assert timing.largest_gap_s is not None
    assert timing.jitter_s is not None
    assert np.isclose(timing.hz * (max(times) - min(times)) / 1e9, len(times) - 1)
    assert 0 <= timing.jitter_s <= timing.largest_gap_s <= (max(times) - min(times)) / 1e9


def test_a_regular_sensor_with_a_gap() -> None:
    timing = timing_of([index * 100_000_000 for index in (0, 1, 2, 3, 8, 9, 10)])
    assert timing.hz == 6.0
    assert timing.largest_gap_s == 0.5
    assert timing.backwards == 0
    assert timing_of([0, 2, 1, 3]).backwards == 1


def test_nothing_has_no_timing() -> None:
    timing = timing_of([])
    assert (timing.hz, timing.jitter_s, timing.largest_gap_s, timing.backwards) == (None, None, None, 0)
