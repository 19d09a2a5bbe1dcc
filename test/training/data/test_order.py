from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.training.data.order import Order, rehearsals_before


def test_each_sample_comes_once_an_epoch() -> None:
    order = Order(12, 0)
    places = [order.index(place) for place in range(24)]
    assert sorted(places[:12]) == sorted(places[12:]) == list(range(12))
    assert places[:12] != places[12:]


@settings(max_examples=30, deadline=None)
@given(count=st.integers(1, 50), seed=st.integers(0, 5), place=st.integers(0, 500))
def test_a_place_is_found_alike_whatever_was_asked_before(count: int, seed: int, place: int) -> None:
    order = Order(count, seed)
    for asked in (place + count, place // 2):
        order.index(asked)
    assert order.index(place) == Order(count, seed).index(place)


@settings(max_examples=50, deadline=None)
@given(share=st.floats(0, 1), place=st.integers(0, 10**7))
def test_rehearsals_are_spread_evenly(share: float, place: int) -> None:
    counts = [rehearsals_before(place + step, share) for step in range(5)]
    assert all(after - before in (0, 1) for before, after in pairwise(counts))
    assert abs(counts[0] - place * share) <= 1
