from __future__ import annotations

import random
from collections import Counter
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.pairing import Pair, Pairer, PairingConfig, PairingError

MS = 1_000_000
SECOND = 1000 * MS
RATES_HZ = [(10, 20), (12, 13), (30, 13)]
MAX_OFFSET_NS = 100 * MS
MAX_WAIT_NS = 100 * MS


@dataclass
class Stream:
    """Messages of one topic: when each was taken and when it comes."""

    stamps_ns: list[int]
    arrivals_ns: list[int]


@dataclass
class Outcome:
    """What a run released: by image stamp, the pair and when it came."""

    pairs: list[Pair] = field(default_factory=list)
    released_ns: list[int] = field(default_factory=list)

    def take(self, pairs: tuple[Pair, ...], now_ns: int) -> None:
        self.pairs.extend(pairs)
        self.released_ns.extend([now_ns] * len(pairs))


def stream(rate_hz, phase, seconds, rng, max_delay_ns=0, jitter=0.0, in_order=False, lost=0.0):
    """Stamps at a rate, the first one `phase` periods from 0; gaps stay within 1 +- 2 jitter periods."""
    period = SECOND / rate_hz
    count = int(seconds * rate_hz - phase) + 1
    stamps = [round((phase + index + rng.uniform(-jitter, jitter)) * period) for index in range(count)]
    stamps = [stamp for stamp in stamps if rng.random() >= lost]
    arrivals = [stamp + rng.randint(0, max_delay_ns) for stamp in stamps]
    if in_order:
        arrivals = [max(arrivals[: index + 1]) for index in range(len(arrivals))]
    return Stream(stamps, arrivals)


def run(pairer, images, radars, tick_ns=None, flush=True):
    events = [
        (now, name, stamp)
        for name, source in {"": images, **radars}.items()
        for stamp, now in zip(source.stamps_ns, source.arrivals_ns, strict=True)
    ]
    if tick_ns:
        last = max(now for now, _, _ in events)
        events += [(now, "tick", 0) for now in range(0, last + MAX_WAIT_NS, tick_ns)]
    outcome = Outcome()
    for now, name, stamp in sorted(events, key=lambda event: event[0]):
        if name == "tick":
            outcome.take(pairer.expire(now), now)
        elif name:
            outcome.take(pairer.add_sweep(name, stamp, stamp, now), now)
        else:
            outcome.take(pairer.add_image(stamp, stamp, now), now)
    if flush:
        outcome.take(pairer.flush(), max(now for now, _, _ in events))
    return outcome


def nearest(image, stamps, start_ns=0):
    near = [stamp for stamp in stamps if abs(stamp - image) <= MAX_OFFSET_NS]
    return min((start_ns + stamp for stamp in near), key=lambda t: (abs(t - start_ns - image), t), default=None)


def sweeps_by_image(outcome):
    assert len({pair.stamp_ns for pair in outcome.pairs}) == len(outcome.pairs)
    return {pair.stamp_ns: pair.sweeps for pair in outcome.pairs}


@pytest.mark.parametrize("rates", RATES_HZ)
@given(
    phases=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    jitter=st.sampled_from([0.0, 0.02, 1 / 14]),
    tick_ns=st.sampled_from([None, 7 * MS, 50 * MS]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=40, deadline=None)
def test_the_true_nearest_sweep_is_found_in_any_order_of_arrival(rates, phases, jitter, tick_ns, seed):
    rng = random.Random(seed)
    period_ns = SECOND // rates[1]
    # The nearest sweep is at most half a (long) gap after the image: with this delay it still comes within the wait.
    max_delay_ns = MAX_WAIT_NS - round(period_ns * (0.5 + jitter)) - 1
    images = stream(rates[0], phases[0], 4, rng, max_delay_ns)
    radar = stream(
        rates[1], phases[1] - 2, 5, rng, max_delay_ns, jitter
    )  # from before the first to after the last image
    outcome = run(Pairer(("radar",)), images, {"radar": radar}, tick_ns)
    expected = {image: (nearest(image, radar.stamps_ns),) for image in images.stamps_ns}
    assert sweeps_by_image(outcome) == expected
    for pair in outcome.pairs:
        assert pair.image == pair.stamp_ns
        if pair.sweeps[0] is not None:
            assert pair.offsets_s[0] == pytest.approx((pair.sweeps[0] - pair.stamp_ns) / SECOND)


@pytest.mark.parametrize("rates", RATES_HZ)
@given(
    phases=st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)),
    jitter=st.sampled_from([0.0, 1 / 14]),
    lost=st.sampled_from([0.0, 0.3]),
    max_delay_ns=st.integers(0, MAX_WAIT_NS),
    tick_ns=st.sampled_from([None, 10 * MS + 1]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=40, deadline=None)
def test_ending_the_wait_early_changes_no_pair_and_no_order(rates, phases, jitter, lost, max_delay_ns, tick_ns, seed):
    rng = random.Random(seed)
    images = stream(rates[0], phases[0], 4, rng, max_delay_ns, in_order=True, lost=lost)
    radars = {
        "front": stream(rates[1], phases[1], 4, rng, max_delay_ns, jitter, lost=lost),
        "rear": stream(13, phases[2], 4, rng, max_delay_ns, jitter, lost=lost),
    }
    pairer = Pairer(tuple(radars))
    outcome = run(pairer, images, radars, tick_ns)
    expected = {}
    for image, came in zip(images.stamps_ns, images.arrivals_ns, strict=True):
        expected[image] = tuple(
            nearest(
                image,
                [
                    stamp
                    for stamp, arrival in zip(radar.stamps_ns, radar.arrivals_ns, strict=True)
                    if arrival <= came + MAX_WAIT_NS
                ],
            )
            for radar in radars.values()
        )
    assert sweeps_by_image(outcome) == expected
    assert [pair.stamp_ns for pair in outcome.pairs] == images.stamps_ns
    if tick_ns:
        arrivals = dict(zip(images.stamps_ns, images.arrivals_ns, strict=True))
        waits = [now - arrivals[pair.stamp_ns] for pair, now in zip(outcome.pairs, outcome.released_ns, strict=True)]
        assert max(waits, default=0) <= MAX_WAIT_NS + tick_ns
    counts = pairer.counts
    assert (counts.images, counts.waiting, counts.overtaken, counts.resets) == (len(images.stamps_ns), 0, 0, 0)
    for index, radar in enumerate(counts.radars):
        assert radar.paired == sum(sweeps[index] is not None for sweeps in expected.values())
        assert radar.unmatched == counts.images - radar.paired


@pytest.mark.parametrize("jitter", [0.0, 0.03])
@pytest.mark.parametrize("rates", RATES_HZ)
def test_no_image_waits_for_more_than_the_next_sweep(rates, jitter):
    rng = random.Random(1)
    delay_ns = 5 * MS
    images = stream(rates[0], 0.4, 20, rng)
    radar = stream(rates[1], 0.6, 20, rng, jitter=jitter)
    radar.arrivals_ns = [stamp + delay_ns for stamp in radar.stamps_ns]
    outcome = run(Pairer(("radar",)), images, {"radar": radar})
    at_once = 0
    for pair, now in zip(outcome.pairs, outcome.released_ns, strict=True):
        if 2 * SECOND < pair.stamp_ns < 19 * SECOND:  # the gaps are known
            assert now <= min(stamp for stamp in radar.stamps_ns if stamp >= pair.stamp_ns) + delay_ns
            before = max(stamp for stamp in radar.stamps_ns if stamp + delay_ns < pair.stamp_ns)
            if pair.stamp_ns - before < 0.3 * SECOND / rates[1]:
                assert now == pair.stamp_ns
                at_once += 1
    assert at_once > 30


def test_a_radar_that_jitters_costs_no_more_than_its_next_sweep_while_sweeps_come_in_order():
    rng = random.Random(2)
    images, radar = stream(10, 0.4, 40, rng), stream(20, 0.6, 40, rng)
    radar.stamps_ns = sorted(round(stamp + rng.gauss(0, 10 * MS)) for stamp in radar.stamps_ns)
    radar.arrivals_ns = [stamp + 5 * MS for stamp in radar.stamps_ns]
    pairer = Pairer(("radar",))
    outcome = run(pairer, images, {"radar": radar}, tick_ns=10 * MS)
    late = [pair for pair in outcome.pairs if pair.sweeps[0] != nearest(pair.stamp_ns, radar.stamps_ns)]
    assert not late
    for pair, now in zip(outcome.pairs, outcome.released_ns, strict=True):
        if 6 * SECOND < pair.stamp_ns < 39 * SECOND:  # that they come in order is known
            assert now <= min(stamp for stamp in radar.stamps_ns if stamp >= pair.stamp_ns) + 5 * MS
    assert sum(pairer.waits_s[-200:]) / 200 < 0.035


def test_the_first_sweep_out_of_order_ends_the_trust_in_their_order():
    pairer = Pairer(("radar",))
    for index in range(150):
        for stamp in (index * 100 * MS, index * 100 * MS + 20 * MS):
            pairer.add_sweep("radar", stamp, stamp, stamp)
    last = 149 * 100 * MS
    # Between the two sweeps around it there is room for another one, but they have long come in order.
    assert len(pairer.add_image(last - 41 * MS, "image", last + 21 * MS)) == 1
    pairer.add_sweep("radar", last - 140 * MS, "out of order", last + 22 * MS)
    assert pairer.add_image(last - 40 * MS, "image", last + 23 * MS) == ()
    assert [pair.sweeps for pair in pairer.expire(last + SECOND)] == [(last - 80 * MS,)]


def looped(source, length_ns, loops):
    """The same stamps again and again, coming later each time."""
    return Stream(
        source.stamps_ns * loops,
        [now + loop * length_ns for loop in range(loops) for now in source.arrivals_ns],
    )


@pytest.mark.parametrize("rates", RATES_HZ)
@given(
    phases=st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)),
    image_delay_ns=st.integers(0, 40 * MS),
    radar_delay_ns=st.integers(0, 40 * MS),
    scatter_ns=st.sampled_from([0, 20 * MS]),
    pause_ns=st.integers(0, 300 * MS),
    start_ns=st.sampled_from([0, 1_700_000_000 * SECOND]),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=30, deadline=None)
def test_each_loop_of_a_bag_gives_the_same_pairs(
    rates, phases, image_delay_ns, radar_delay_ns, scatter_ns, pause_ns, start_ns, seed
):
    # Different delays interleave the streams differently where one loop ends and the next begins.
    rng = random.Random(seed)
    seconds, loops = 2, 3
    images = stream(rates[0], phases[0], seconds, rng, scatter_ns, in_order=True)
    radars = {
        "front": stream(rates[1], phases[1], seconds, rng, scatter_ns),
        "rear": stream(13, phases[2], seconds, rng, scatter_ns),
    }
    delays = {"": image_delay_ns, "front": radar_delay_ns, "rear": 20 * MS}
    streams = {
        name: looped(
            Stream([start_ns + t for t in source.stamps_ns], [now + delays[name] for now in source.arrivals_ns]),
            seconds * SECOND + pause_ns,
            loops,
        )
        for name, source in {"": images, **radars}.items()
    }
    # Near the ends of a loop the nearest sweep may be 100 ms away: long enough a wait for that and all delays.
    pairer = Pairer(tuple(radars), PairingConfig(max_wait_s=0.2))
    outcome = run(pairer, streams.pop(""), streams)
    expected = {
        (start_ns + image, *(nearest(image, source.stamps_ns, start_ns) for source in radars.values())): loops
        for image in images.stamps_ns
    }
    assert Counter((pair.stamp_ns, *pair.sweeps) for pair in outcome.pairs) == expected
    assert pairer.counts.resets == loops - 1
    assert pairer.counts.duplicates == 0


def test_a_clock_that_is_set_back_costs_no_more_than_the_moment():
    rng = random.Random(3)
    images, radar = stream(30, 0.1, 6, rng), stream(13, 0.5, 6, rng)
    step_ns = 3 * SECOND + 700 * MS
    for source in (images, radar):
        source.stamps_ns = [t - (step_ns if t > 3 * SECOND else 0) for t in source.stamps_ns]
    pairer = Pairer(("radar",))
    outcome = run(pairer, images, {"radar": radar})
    assert len(outcome.pairs) == len(images.stamps_ns)
    assert all(pair.sweeps[0] is not None for pair in outcome.pairs)
    assert max(abs(pair.offsets_s[0]) for pair in outcome.pairs) < 1 / 13
    assert pairer.counts.resets == 1


@pytest.mark.parametrize("wrong_ns", [0, 10_000 * SECOND])
@pytest.mark.parametrize("what", ["image", "sweep"])
def test_a_single_wrong_stamp_does_not_part_the_streams(what, wrong_ns):
    rng = random.Random(5)
    images, radar = stream(30, 0.1, 8, rng), stream(13, 0.5, 8, rng)
    for source in (images, radar):
        source.stamps_ns = [t + 100 * SECOND for t in source.stamps_ns]
    spoilt = images if what == "image" else radar
    index = len(spoilt.stamps_ns) // 2
    spoilt.stamps_ns[index] = wrong_ns
    outcome = run(Pairer(("radar",)), images, {"radar": radar})
    right = [pair for pair in outcome.pairs if pair.stamp_ns != wrong_ns]
    assert len(outcome.pairs) == len(images.stamps_ns)
    assert {pair.stamp_ns: pair.sweeps[0] for pair in right} == {
        pair.stamp_ns: nearest(pair.stamp_ns, radar.stamps_ns) for pair in right
    }


@pytest.mark.parametrize("offset_s", [1_700_000_000, -1_700_000_000, -0.5, 0.5])
def test_a_radar_that_has_another_clock_stops_nothing(offset_s):
    rng = random.Random(6)
    images, radar = stream(10, 0.0, 3, rng), stream(13, 0.0, 3, rng)
    radar.stamps_ns = [stamp + round(offset_s * SECOND) for stamp in radar.stamps_ns]
    pairer = Pairer(("radar",))
    outcome = run(pairer, images, {"radar": radar}, tick_ns=10 * MS)
    assert [pair.stamp_ns for pair in outcome.pairs] == images.stamps_ns
    counts = pairer.counts
    assert counts.resets == 0
    if offset_s == 0.5:  # sweeps from before the image came: they are still there
        assert counts.paired >= counts.images - 6
    else:
        assert counts.paired == 0


def test_a_silent_radar_costs_the_wait_and_no_image():
    pairer = Pairer(("front", "rear"))
    for index in range(3):
        pairer.add_sweep("front", index * 50 * MS, f"sweep {index}", index * 50 * MS)
    assert pairer.add_image(100 * MS, "image", 101 * MS) == ()
    assert pairer.deadline_ns == 201 * MS
    assert pairer.expire(200 * MS) == ()
    (pair,) = pairer.expire(201 * MS)
    assert pair == Pair(100 * MS, "image", ("sweep 2", None), (0.0, None))
    assert pairer.deadline_ns is None
    counts = pairer.counts
    assert (counts.paired, counts.unmatched) == (1, 0)
    assert [(radar.name, radar.paired, radar.unmatched) for radar in counts.radars] == [
        ("front", 1, 0),
        ("rear", 0, 1),
    ]


def test_the_wait_ends_without_a_timer_when_the_next_message_comes():
    pairer = Pairer(("radar",))
    assert pairer.add_image(0, "first", 0) == ()
    (pair,) = pairer.add_image(500 * MS, "second", 500 * MS)
    assert (pair.image, pair.sweeps) == ("first", (None,))


def test_without_radars_images_go_straight_through():
    pairer = Pairer(())
    (pair,) = pairer.add_image(5, "image", 0)
    assert pair == Pair(5, "image", (), ())
    assert pairer.counts.unmatched == 1


def test_without_waiting_each_image_takes_what_is_there():
    pairer = Pairer(("radar",), PairingConfig(max_wait_s=0.0))
    pairer.add_sweep("radar", 10 * MS, "sweep", 10 * MS)
    (pair,) = pairer.add_image(40 * MS, "image", 40 * MS)
    assert (pair.sweeps, pair.offsets_s) == (("sweep",), (-0.03,))


def test_of_two_sweeps_at_the_same_distance_the_earlier_is_taken():
    for order in ((-20, 20), (20, -20)):
        pairer = Pairer(("radar",))
        pairer.add_image(100 * MS, "image", 0)
        for offset in order:
            pairer.add_sweep("radar", (100 + offset) * MS, offset, 1)
        (pair,) = pairer.flush()
        assert pair.sweeps == (-20,)


def test_a_sweep_further_away_than_allowed_is_not_taken():
    for offset_ns, sweeps in ((30 * MS, ("sweep",)), (30 * MS + 1, (None,)), (-30 * MS - 1, (None,))):
        pairer = Pairer(("radar",), PairingConfig(max_time_offset_s=0.03))
        pairer.add_image(SECOND, "image", 0)
        pairer.add_sweep("radar", SECOND + offset_ns, "sweep", 0)
        assert [pair.sweeps for pair in pairer.flush()] == [sweeps]


def test_late_sweeps_are_counted_once_and_only_when_nearer():
    pairer = Pairer(("radar",))
    pairer.add_sweep("radar", 980 * MS, "early", 0)
    pairer.add_image(1000 * MS, "first", 0)
    pairer.add_image(1001 * MS, "second", 0)
    assert len(pairer.expire(SECOND)) == 2
    pairer.add_sweep("radar", 1030 * MS, "further away", SECOND)
    assert pairer.counts.radars[0].late == 0
    pairer.add_sweep("radar", 1010 * MS, "nearer", SECOND)
    assert pairer.counts.radars[0].late == 1


def test_duplicates_are_dropped_and_counted():
    pairer = Pairer(("radar",))
    pairer.add_sweep("radar", 0, "sweep", 0)
    pairer.add_sweep("radar", 0, "again", 0)
    (pair,) = pairer.add_image(0, "image", 0)
    assert pair.sweeps == ("sweep",)
    assert pairer.add_image(0, "again", 0) == ()
    pairer.add_image(50 * MS, "waits", 0)
    pairer.add_image(50 * MS, "again", 0)
    counts = pairer.counts
    assert (counts.images, counts.waiting, counts.duplicates, counts.radars[0].duplicates) == (2, 1, 2, 1)


def test_an_image_that_was_overtaken_still_comes():
    pairer = Pairer(("radar",))
    pairer.add_sweep("radar", 50 * MS, "sweep", 50 * MS)
    assert [pair.image for pair in pairer.add_image(50 * MS, "second", 50 * MS)] == ["second"]
    assert pairer.add_image(20 * MS, "first", 60 * MS) == ()
    assert [pair.image for pair in pairer.flush()] == ["first"]
    assert pairer.counts.overtaken == 1


def test_memory_is_bounded_when_the_clock_stands_still():
    pairer = Pairer(("radar",))
    sweep_and_image = object()
    for index in range(1000):
        pairer.add_sweep("radar", index * 10 * MS, sweep_and_image, 0)
        pairer.add_image(index * 1000 * MS + 1, sweep_and_image, 0)
    assert pairer.counts.waiting <= 64
    held = {name: len(value) for name, value in vars(pairer._sweeps[0]).items() if hasattr(value, "__len__")}
    assert max(held.values()) <= 256
    assert len(held) == 5


def test_a_bag_played_slowly_is_paired_as_well():
    rng = random.Random(7)
    images, radar = stream(10, 0.2, 3, rng), stream(13, 0.7, 3, rng)
    for source in (images, radar):
        source.arrivals_ns = [30 * stamp for stamp in source.stamps_ns]
    outcome = run(Pairer(("radar",)), images, {"radar": radar})
    assert all(pair.sweeps[0] is not None for pair in outcome.pairs[1:])


def test_what_cannot_work_is_refused():
    for options in ({"max_wait_s": -1.0}, {"max_time_offset_s": float("nan")}, {"radar_time_offset_s": float("inf")}):
        with pytest.raises(PairingError, match=f"{next(iter(options))} must be"):
            PairingConfig(**options)
    with pytest.raises(PairingError, match="named once"):
        Pairer(("radar", "radar"))
    with pytest.raises(PairingError, match="no radar 'rear' to pair, only front"):
        Pairer(("front",)).add_sweep("rear", 0, "sweep", 0)
