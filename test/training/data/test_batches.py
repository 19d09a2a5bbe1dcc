from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import torch
from small_training import RECIPE

from radcam_depth_ros.training.data.batches import BatchMaker, collate, prefetch
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.errors import TrainingError


def test_a_batch_has_the_layout_that_networks_take(drive: CachedDrive) -> None:
    batch = collate([drive[0], drive[1]])
    assert batch.image.shape == (2, 3, 64, 128)
    assert batch.image.is_contiguous(memory_format=torch.channels_last)
    assert batch.image.max() <= 1
    assert batch.radar.shape == (2, 16, 6)
    assert batch.valid.sum(dim=1).tolist() == [3, 3]
    assert torch.isfinite(batch.radar[~batch.valid]).all()
    assert batch.ground.shape == (2, 4)
    assert batch.depth_accumulated_m.shape == (2, 1, 64, 128)
    assert torch.isinf(batch.depth_accumulated_m[0, 0, 0, 1])
    assert batch.classes.shape == (2, 64, 128)
    assert batch.to(torch.device("cpu")).depth_single_m is None


def test_a_batch_is_a_function_of_its_position(drive: CachedDrive) -> None:
    samples = SampleSet.of([drive])
    first, again = (BatchMaker(samples, RECIPE.augmentation, 3).make(8, 2, (32, 64)) for _ in range(2))
    other = BatchMaker(samples, RECIPE.augmentation, 4).make(8, 2, (32, 64))
    assert torch.equal(first.image, again.image)
    assert torch.equal(first.radar.nan_to_num(), again.radar.nan_to_num())
    assert not torch.equal(first.image, other.image)


def test_rehearsals_are_an_even_share_of_the_samples(drive: CachedDrive) -> None:
    samples = SampleSet.of([drive])
    own, rehearsal = samples.split(0.5)
    seen = []
    for share, expected in ((0.5, [1, 1, 1, 1]), (0.25, [0, 1, 0, 1]), (0.0, [0, 0, 0, 0])):
        maker = BatchMaker(own, RECIPE.augmentation, 0, rehearsal, share)
        drawn = [maker._sample(place).image for place in range(8)]
        is_rehearsal = [
            any(np.array_equal(image, other.image) for other in map(rehearsal.__getitem__, range(len(rehearsal))))
            for image in drawn
        ]
        assert [sum(is_rehearsal[start : start + 2]) for start in (0, 2, 4, 6)] == expected
        seen.append(sum(is_rehearsal))
    assert seen == [4, 2, 0]


def test_batches_made_ahead_come_in_order(drive: CachedDrive) -> None:
    maker = BatchMaker(SampleSet.of([drive]), RECIPE.augmentation, 0)
    with ThreadPoolExecutor(2) as pool, closing(prefetch(maker, 4, 2, [(32, 64)], pool, 3, 2)) as batches:
        for position in (4, 6, 8, 10, 12):
            assert torch.equal(next(batches).image, maker.make(position, 2, (32, 64)).image)


def test_splitting_and_spreading(drive: CachedDrive) -> None:
    train, held_out = SampleSet.of([drive, drive]).split(0.25)
    assert (len(train), len(held_out)) == (9, 3)
    np.testing.assert_array_equal(held_out[2].image, drive[5].image)
    assert train.spread(3) == (0, 4, 8)
    assert held_out.spread(40) == (0, 1, 2)
    assert train.largest == (64, 128)
    with pytest.raises(TrainingError, match="no frame"):
        SampleSet.of([])


def test_pictures_are_replaced_as_often_as_asked_and_batches_say_so(drive: CachedDrive) -> None:
    samples = SampleSet.of([drive])
    plain = replace(RECIPE.augmentation, unreadable=0.0, foreign=0.0)
    kept = BatchMaker(samples, plain, 0).make(0, 8, (32, 64))
    assert kept.readable.all()
    unreadable = BatchMaker(samples, replace(plain, unreadable=1.0), 0).make(0, 8, (32, 64))
    assert 0 < int(unreadable.readable.sum()) < 8, "some kinds may still tell something"
    assert not torch.equal(unreadable.image, kept.image)
    foreign = BatchMaker(samples, replace(plain, foreign=1.0), 0).make(0, 8, (32, 64))
    assert not foreign.readable.any()
    torch.testing.assert_close(foreign.image, kept.image.roll(-1, 0))
    for batch in (unreadable, foreign):
        torch.testing.assert_close(batch.depth_accumulated_m, kept.depth_accumulated_m, equal_nan=True)
        torch.testing.assert_close(batch.radar, kept.radar, equal_nan=True)


@pytest.mark.parametrize("shares", [{"unreadable": 0.7, "foreign": 0.4}, {"foreign": -0.1}, {"unreadable": 1.1}])
def test_shares_of_replaced_pictures_are_checked(shares: dict[str, float]) -> None:
    with pytest.raises(TrainingError, match="unreadable and foreign must be at least 0 and at most 1 together"):
        replace(RECIPE.augmentation, **shares)


def test_samples_that_come_later_are_taken_from_a_place_on(drive: CachedDrive) -> None:
    samples = SampleSet.of([drive]).split(0.5)[0]
    maker, still = (BatchMaker(samples, RECIPE.augmentation, 0) for _ in range(2))
    grown = samples.grown([drive, drive])
    assert len(grown) == 15
    np.testing.assert_array_equal(grown[3].image, drive[0].image)
    np.testing.assert_array_equal(grown[14].image, drive[5].image)
    maker.grow(grown, 6)
    assert torch.equal(maker.make(4, 2, (32, 64)).image, still.make(4, 2, (32, 64)).image)
    seen = {maker._sample(place).image.tobytes() for place in range(6, 21)}
    assert seen == {drive[index].image.tobytes() for index in range(6)}
