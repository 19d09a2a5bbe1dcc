from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.training.data.order import MixedOrder, Order, rehearsals_before


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


@settings(max_examples=50, deadline=None)
@given(share=st.sampled_from([0.0, 0.25, 0.5]), place=st.integers(0, 60))
def test_a_set_that_grows_is_taken_in_another_order_from_a_place_on(share: float, place: int) -> None:
    order, still = MixedOrder(5, 3, 4, share), MixedOrder(5, 3, 4, share)
    order.grow(8, place)
    assert [order.at(earlier) for earlier in range(place)] == [still.at(earlier) for earlier in range(place)]
    later = [order.at(place + step) for step in range(80)]
    assert [is_rehearsal for is_rehearsal, _ in later] == [still.at(place + step)[0] for step in range(80)]
    own = [index for is_rehearsal, index in later if not is_rehearsal]
    assert sorted(own[:8]) == sorted(own[8:16]) == list(range(8))
