from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane
from radcam_depth_ros.training.data.copy_paste import Pasting, Patch, Thing, pasted, spots_of, things_of
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS, TrainingSample
from radcam_depth_ros.training.data.views import View

CAMERA = CameraModel(160, 96, 100.0, 100.0, 80.0, 40.0)
HEIGHT_M = 1.5
ROAD, SKY, POLE, PERSON, CAR = (CLASS_NAMES.index(name) for name in ("road", "sky", "pole", "person", "car"))
WHOLE = View(0, 0, 96, 160, (96, 160), False)


def road_sample(things: Sequence[tuple[int, float, int, int]] = (), brightness: int = 80) -> TrainingSample:
    """A flat road below a sky; things (class, metres, left column, width in columns), 1.8 m high, stand on it."""
    rows = np.arange(96)[:, None]
    depth_m = np.where(rows > 41, CAMERA.fy * HEIGHT_M / np.maximum(rows - CAMERA.cy, 1), np.inf) + np.zeros((96, 160))
    classes = np.where(np.isinf(depth_m), SKY, ROAD).astype(np.uint8)
    image = np.full((96, 160, 3), brightness, np.uint8)
    radar = []
    for label, metres, left, width in things:
        foot = round(CAMERA.cy + CAMERA.fy * HEIGHT_M / metres)
        place = (slice(foot - round(CAMERA.fy * 1.8 / metres), foot), slice(left, left + width))
        depth_m[place], classes[place], image[place] = metres, label, 200
        radar.append([left + width / 2, foot - 5, metres, 3.0, 1.0, 0.0])
    return TrainingSample(
        image=image,
        depth_m=depth_m.astype(np.float16),
        classes=classes,
        radar=np.array(radar, np.float32).reshape(-1, 6),
        radar_source=np.zeros(len(radar), np.uint8),
        camera=CAMERA,
        ground=GroundPlane(HEIGHT_M),
    )


def put(
    things: Sequence[Thing],
    sample: TrainingSample,
    view: View = WHOLE,
    seed: int = 0,
    most: int = 1,
    spots: FloatArray | None = None,
) -> tuple[TrainingSample, tuple[Patch, ...]]:
    pasting = Pasting((), most, np.random.default_rng(seed))
    spots = spots_of(sample) if spots is None else spots
    patches, returns = pasting.planned(things, spots, view, sample.camera.fx)
    return pasting.with_returns(pasted(view.of(sample), patches), returns), patches


def test_what_stands_free_on_the_ground_is_a_thing() -> None:
    (thing,) = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    assert thing.kind == 0
    assert thing.classes.shape == (30, 9)
    assert (thing.classes == PERSON).all()
    assert (thing.depth_m == 6.0).all()
    assert (thing.image == 200).all()
    assert thing.foot == (4.0, 29.0)
    assert thing.foot_m == pytest.approx(6.0, rel=0.05)
    assert thing.brightness == 80
    np.testing.assert_allclose(thing.radar, [[4.5, 25.0, 6.0, 3.0, 1.0, 0.0]])


@pytest.mark.parametrize(
    ("what", "sample"),
    [
        ("a car is none", road_sample([(CAR, 6.0, 70, 20)])),
        ("cut off by the border", road_sample([(PERSON, 6.0, 0, 9)])),
        ("too small", road_sample([(PERSON, 30.0, 70, 2)])),
        ("behind a car", road_sample([(PERSON, 6.0, 70, 9), (CAR, 5.5, 60, 30)])),
        ("two at once, far apart", road_sample([(PERSON, 14.0, 70, 9), (PERSON, 6.0, 79, 9)])),
        ("classes are unknown", replace(road_sample(), classes=np.broadcast_to(np.uint8(UNKNOWN_CLASS), (96, 160)))),
    ],
)
def test_what_is_not_whole_or_does_not_stand_free_is_none(what: str, sample: TrainingSample) -> None:
    assert not things_of(sample), what


def test_what_hovers_is_no_thing() -> None:
    sample = road_sample([(POLE, 6.0, 70, 9)])
    nearer = np.where(sample.classes == POLE, np.float16(4.0), sample.depth_m)
    assert not things_of(replace(sample, depth_m=nearer))


def test_a_thing_stands_on_the_ground_at_its_size() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    for seed in range(20):
        result, (patch,) = put(things, road_sample(), seed=seed)
        mask = result.classes == PERSON
        metres = np.unique(result.depth_m[mask].astype(np.float32))
        assert len(metres) == 1
        rows = np.flatnonzero(mask.any(1))
        # As far as the road a row above or below its foot.
        nearest, farthest = (CAMERA.fy * HEIGHT_M / (rows[-1] - CAMERA.cy + step) for step in (1, -1))
        assert 0.97 * nearest < metres[0] < 1.03 * farthest
        if patch.top > 0:
            assert len(rows) == pytest.approx(CAMERA.fy * 1.8 / metres[0], rel=0.1, abs=1)
        (u, v, depth_m, *rest), columns = result.radar[0], np.flatnonzero(mask.any(0))
        assert depth_m == pytest.approx(metres[0], rel=1e-3)
        assert rest == [3.0, 1.0, 0.0]
        assert columns[0] - 1 <= u <= columns[-1] + 1
        assert patch.top <= v <= rows[-1] + 1


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_view_moves_things_with_the_ground(is_mirrored: bool) -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    sample = road_sample()
    view = View(4, 10, 88, 140, (110, 175), is_mirrored)
    spots = np.array([[80, 65, 6.0, 80.0]], np.float32)
    whole, (plain,) = put(things, sample, spots=spots)
    seen, (moved,) = put(things, sample, view, spots=spots)
    for length, before in zip(moved.alpha.shape, plain.alpha.shape, strict=True):
        assert length == pytest.approx(1.25 * before, abs=1.2)
    expected = view.of(whole)
    both = ((seen.classes == PERSON) & (expected.classes == PERSON)).sum()
    assert both > 0.7 * max((seen.classes == PERSON).sum(), (expected.classes == PERSON).sum())
    np.testing.assert_allclose(seen.radar, view.of(whole).radar, atol=2)


def test_things_are_put_where_the_view_is() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    for seed in range(10):
        view = View(30, 100, 60, 50, (60, 50), False)
        seen, (_,) = put(things, road_sample(), view, seed)
        assert (seen.classes == PERSON).any()
    assert not put(things, road_sample(), View(0, 0, 30, 50, (30, 50), False))[1]


def test_what_is_nearer_stays_in_front_and_what_is_unknown_stays_unknown() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    sample = road_sample()
    _, patches = put(things, sample)
    wall = replace(sample, depth_m=np.full_like(sample.depth_m, 1.5), classes=np.full_like(sample.classes, CAR))
    np.testing.assert_array_equal(pasted(wall, patches).image, wall.image)
    unknown = replace(sample, depth_m=np.full_like(sample.depth_m, np.nan))
    np.testing.assert_array_equal(pasted(unknown, patches).classes, sample.classes)


def test_a_single_scan_has_not_met_it() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    sample = road_sample()
    result, _ = put(things, replace(sample, depth_single_m=sample.depth_m))
    assert result.depth_single_m is not None
    np.testing.assert_array_equal(np.isnan(result.depth_single_m), result.classes == PERSON)


def test_a_thing_is_as_bright_as_the_ground_it_comes_to() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)], brightness=80))
    dark, _ = put(things, road_sample(brightness=38))
    assert dark.image[dark.classes == PERSON].max() == pytest.approx(200 / 2, abs=1)


def test_the_nearer_of_two_things_is_in_front() -> None:
    things = things_of(road_sample([(PERSON, 6.0, 70, 9), (POLE, 5.0, 120, 6)]))
    _, patches = put(things, road_sample(), most=6, seed=1)
    metres = [float(np.nanmin(patch.depth_m)) for patch in patches]
    assert len(metres) > 1
    assert metres == sorted(metres, reverse=True)


def test_how_often_and_from_where_is_a_function_of_seed_and_place() -> None:
    drawn = [Pasting.drawn(7, place, 0.25, 3) for place in range(2000)]
    assert 430 < sum(entry is not None for entry in drawn) < 570
    for place, entry in enumerate(drawn):
        again = Pasting.drawn(7, place, 0.25, 3)
        if entry is not None:
            assert again is not None
            assert entry.donors == again.donors
            assert min(entry.donors) > place
    assert all(Pasting.drawn(7, place, 0.0, 3) is None for place in range(100))


def test_a_sample_without_ground_or_things_stays_as_it_is() -> None:
    sample = road_sample()
    assert not put((), sample)[1]
    bare = replace(sample, classes=np.full_like(sample.classes, SKY))
    things = things_of(road_sample([(PERSON, 6.0, 70, 9)]))
    result, patches = put(things, bare, most=5)
    assert not patches
    np.testing.assert_array_equal(result.image, bare.image)
