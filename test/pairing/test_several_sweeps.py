from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radcam_depth_ros.pairing import MAX_SWEEPS, EarlierSweep, Pair, Pairer, PairingConfig, PairingError

MS = 1_000_000
SECOND = 1000 * MS
Event = tuple[int, str, int, int]  # arrival, radar or "" for an image, stamp, loop


def events(seed: int, max_delay_ms: int, loops: int = 1, seconds: float = 1.5) -> list[Event]:
    """Images at 10 Hz, radars at 13 and 20 Hz, that come late and out of order, again and again."""
    rng = random.Random(seed)
    found: list[Event] = []
    for loop in range(loops):
        start_ns = round(loop * (seconds + 0.2) * SECOND)
        for name, rate_hz in (("", 10), ("front", 13), ("rear", 20)):
            phase = rng.random() if loop == 0 else 0.5
            for index in range(int(seconds * rate_hz)):
                stamp_ns = round((index + phase) * SECOND / rate_hz)
                found.append((start_ns + stamp_ns + rng.randint(0, max_delay_ms) * MS, name, stamp_ns, loop))
    return sorted(found)


def play(config: PairingConfig, messages: list[Event]) -> list[tuple[int, Pair]]:
    """When each pair came, and the pair; images and sweeps are (stamp, loop)."""
    pairer: Pairer = Pairer(("front", "rear"), config)
    pairs: list[tuple[int, Pair]] = []
    for now_ns, name, stamp_ns, loop in messages:
        value = (stamp_ns, loop)
        ready = pairer.add_sweep(name, stamp_ns, value, now_ns) if name else pairer.add_image(stamp_ns, value, now_ns)
        pairs += [(now_ns, pair) for pair in ready]
    return pairs + [(messages[-1][0], pair) for pair in pairer.flush()]


@given(seed=st.integers(0, 2**32), max_delay_ms=st.sampled_from([0, 30, 90]), sweeps=st.integers(2, MAX_SWEEPS))
@settings(max_examples=15, deadline=None)
def test_several_sweeps_change_nothing_of_the_nearest_one(seed: int, max_delay_ms: int, sweeps: int) -> None:
    messages = events(seed, max_delay_ms)
    single, several = play(PairingConfig(), messages), play(PairingConfig(radar_sweeps=sweeps), messages)
    assert all(pair.earlier == () for _, pair in single)
    assert single == [(now_ns, replace(pair, earlier=())) for now_ns, pair in several]


@given(
    seed=st.integers(0, 2**32),
    max_delay_ms=st.sampled_from([0, 30, 90]),
    sweeps=st.integers(2, MAX_SWEEPS),
    max_age_s=st.sampled_from([0.0, 0.2, 1.0]),
)
@settings(max_examples=15, deadline=None)
def test_those_before_are_the_newest_that_came(seed: int, max_delay_ms: int, sweeps: int, max_age_s: float) -> None:
    messages = events(seed, max_delay_ms)
    for now_ns, pair in play(PairingConfig(radar_sweeps=sweeps, max_sweep_age_s=max_age_s), messages):
        for radar, nearest, earlier in zip(("front", "rear"), pair.sweeps, pair.earlier, strict=True):
            came = [stamp for arrival, name, stamp, _ in messages if name == radar and arrival <= now_ns]
            oldest_ns = pair.stamp_ns - round(max_age_s * SECOND)
            before = sorted((s for s in came if nearest and oldest_ns <= s < nearest[0]), reverse=True)[: sweeps - 1]
            assert len(earlier) <= sweeps - 1
            # Of messages that come at one moment the pair may have been made before the last of them.
            last = {stamp for arrival, name, stamp, _ in messages if name == radar and arrival == now_ns}
            found = [item.sweep[0] for item in earlier]
            assert found == before or found == [stamp for stamp in before if stamp not in last]
            assert [item.offset_s for item in earlier] == pytest.approx([(s - pair.stamp_ns) / SECOND for s in found])


@given(seed=st.integers(0, 2**32), max_delay_ms=st.sampled_from([0, 30]))
@settings(max_examples=10, deadline=None)
def test_no_sweep_of_another_loop_comes_along(seed: int, max_delay_ms: int) -> None:
    pairs = play(PairingConfig(radar_sweeps=MAX_SWEEPS, max_sweep_age_s=5.0), events(seed, max_delay_ms, loops=3))
    assert len({pair.image[1] for _, pair in pairs}) == 3
    for _, pair in pairs:
        for nearest, earlier in zip(pair.sweeps, pair.earlier, strict=True):
            loops = {sweep[1] for sweep in (nearest, *(item.sweep for item in earlier)) if sweep is not None}
            assert loops <= {pair.image[1]}


def test_without_a_sweep_near_enough_older_ones_are_not_taken() -> None:
    pairer: Pairer = Pairer(("radar",), PairingConfig(radar_sweeps=3))
    for stamp_ms in (100, 200, 300):
        pairer.add_sweep("radar", stamp_ms * MS, stamp_ms, stamp_ms * MS)
    pairer.add_image(320 * MS, "near", 320 * MS)
    (pair,) = pairer.flush()
    assert pair.sweeps == (300,)
    assert pair.earlier == ((EarlierSweep(200, -0.12), EarlierSweep(100, -0.22)),)
    pairer.add_image(450 * MS, "far", 450 * MS)
    (pair,) = pairer.flush()
    assert (pair.sweeps, pair.earlier) == ((None,), ((),))


@pytest.mark.parametrize(
    "wrong", [{"radar_sweeps": 0}, {"radar_sweeps": 11}, {"max_sweep_age_s": -1.0}, {"max_sweep_age_s": 11.0}]
)
def test_limits(wrong: dict[str, float]) -> None:
    with pytest.raises(PairingError, match=next(iter(wrong))):
        PairingConfig(**wrong)  # type: ignore[arg-type]
