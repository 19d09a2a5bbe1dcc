from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from small_training import RECIPE

from radcam_depth_ros import configuration, recipes
from radcam_depth_ros.training.data.augmentation import AugmentationConfig
from radcam_depth_ros.training.data.batches import Batch, BatchMaker
from radcam_depth_ros.training.data.copy_paste import Patch
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import CachedDrive, TrainingSample
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.recipe import TrainingConfig, load
from radcam_depth_ros.training.resident import batches, store
from radcam_depth_ros.training.resident.batches import ResidentBatchMaker
from radcam_depth_ros.training.resident.store import ResidentSamples

CPU = torch.device("cpu")
FULL = configuration.overlaid(RECIPE.augmentation, {"focal_jitter": 0.1, "mirror": 0.5}, "the test")
"""Of views, returns and road."""


def without_looks(config: AugmentationConfig) -> AugmentationConfig:
    """The same with no effect on light and appearance."""
    nothing = dict.fromkeys(("tone", "colour", "grey", "illumination", "shadow", "blur", "noise"), 0.0)
    effects = ("recolour", "texture", "sky", "haze", "tone_curve", "channel_mixing", "spectrum", "equalise", "sharpen")
    return replace(
        config,
        photometric=replace(config.photometric, **nothing),
        appearance=replace(config.appearance, **dict.fromkeys((*effects, "jpeg"), 0.0)),
        unreadable=0.0,
        foreign=0.0,
    )


def recipe_with_looks() -> TrainingConfig:
    """That for simulated drives: it has nearly all effects."""
    return load(recipes.shipped("baff").with_name("simulated.yaml"))  # type: ignore[union-attr]


def resident(samples: SampleSet, config: AugmentationConfig, size: tuple[int, int], seed: int = 0) -> Batch:
    maker = ResidentBatchMaker(samples, config, seed, None, 0.0, CPU)
    return maker.finish(maker.make(8, 6, size))


@pytest.fixture
def samples(drive: CachedDrive) -> SampleSet:
    return SampleSet.of([drive])


@pytest.mark.parametrize("size", [(32, 64), (64, 128), (96, 160)])
def test_without_looks_a_batch_is_the_one_of_samples_on_a_disk(samples: SampleSet, size: tuple[int, int]) -> None:
    config = without_looks(FULL)
    mine, theirs = resident(samples, config, size), BatchMaker(samples, config, 0).make(8, 6, size)
    assert mine.image.is_contiguous(memory_format=torch.channels_last)
    # OpenCV rounds its weights to 11 bits.
    torch.testing.assert_close(mine.image, theirs.image, atol=1.01 / 255, rtol=0)
    for name in ("radar", "valid", "ground", "depth_accumulated_m", "classes", "readable"):
        torch.testing.assert_close(getattr(mine, name), getattr(theirs, name), equal_nan=True, rtol=0, atol=0)
    assert mine.depth_single_m is None


def test_a_single_scan_is_kept_beside_the_accumulated_ones(samples: SampleSet, monkeypatch: Any) -> None:
    read = CachedDrive.__getitem__

    def with_scan(drive: CachedDrive, index: int) -> TrainingSample:
        sample = read(drive, index)
        return sample if index % 2 else replace(sample, depth_single_m=sample.depth_m + np.float16(1))

    monkeypatch.setattr(CachedDrive, "__getitem__", with_scan)
    config = without_looks(FULL)
    mine, theirs = resident(samples, config, (32, 64)), BatchMaker(samples, config, 0).make(8, 6, (32, 64))
    assert mine.depth_single_m is not None
    torch.testing.assert_close(mine.depth_single_m, theirs.depth_single_m, equal_nan=True, rtol=0, atol=0)


def test_a_batch_is_a_function_of_its_position_and_the_seed(samples: SampleSet) -> None:
    config = recipe_with_looks().augmentation
    first, again, other = (resident(samples, config, (64, 96), seed) for seed in (3, 3, 4))
    assert torch.equal(first.image, again.image)
    assert not torch.equal(first.image, other.image)


def test_pictures_are_replaced_as_often_as_asked_and_batches_say_so(samples: SampleSet) -> None:
    plain = without_looks(FULL)
    kept = resident(samples, plain, (64, 96))
    assert kept.readable.all()
    little = resident(samples, replace(plain, unreadable=1.0), (64, 96))
    assert not little.readable.all()
    assert (little.image != kept.image).flatten(1).any(1).all()
    foreign = resident(samples, replace(plain, foreign=1.0), (64, 96))
    assert not foreign.readable.any()
    torch.testing.assert_close(foreign.image, kept.image.roll(-1, 0))
    for batch in (little, foreign):
        torch.testing.assert_close(batch.depth_accumulated_m, kept.depth_accumulated_m, equal_nan=True)
        torch.testing.assert_close(batch.radar, kept.radar, equal_nan=True)


def test_rehearsed_samples_come_as_often_as_from_a_disk(samples: SampleSet) -> None:
    own, rehearsal = samples.split(0.5)
    config = without_looks(FULL)
    maker = ResidentBatchMaker(own, config, 0, rehearsal, 0.5, CPU)
    mine = maker.finish(maker.make(0, 4, (32, 64)))
    theirs = BatchMaker(own, config, 0, rehearsal, 0.5).make(0, 4, (32, 64))
    torch.testing.assert_close(mine.depth_accumulated_m, theirs.depth_accumulated_m, equal_nan=True, rtol=0, atol=0)


def test_samples_that_are_too_many_for_a_device_are_refused(samples: SampleSet, monkeypatch: Any) -> None:
    monkeypatch.setattr(store.torch.cuda, "mem_get_info", lambda device: (100_000, 200_000))
    with pytest.raises(TrainingError, match=r"samples take 0.0 GiB, .* set samples: disk in the recipe, or train on"):
        ResidentSamples(samples, torch.device("cuda"))


def test_samples_that_come_later_are_taken_from_a_place_on(drive: CachedDrive) -> None:
    samples = SampleSet.of([drive]).split(0.5)[0]
    config = without_looks(FULL)
    mine, theirs = ResidentBatchMaker(samples, config, 0, None, 0.0, CPU), BatchMaker(samples, config, 0)
    grown = samples.grown([drive])
    for maker in (mine, theirs):
        maker.grow(grown, 6)
    for position in (0, 6, 12):
        made, expected = mine.finish(mine.make(position, 3, (32, 64))), theirs.make(position, 3, (32, 64))
        torch.testing.assert_close(
            made.depth_accumulated_m, expected.depth_accumulated_m, equal_nan=True, rtol=0, atol=0
        )


def with_poles(drive: CachedDrive, index: int) -> TrainingSample:
    """A pole in each sample, on its road."""
    sample = READ(drive, index)
    depth_m, classes = sample.depth_m.copy(), sample.classes.copy()
    image, left = sample.image.copy(), 4 + 3 * index
    place = (slice(14, 48), slice(left, left + 4))
    depth_m[:], classes[:] = sample.depth_m[:, :1], 0
    image[place], depth_m[place], classes[place] = 20 * index + 30, sample.depth_m[47, 0], 5
    return replace(sample, image=image, depth_m=depth_m, classes=classes)


READ = CachedDrive.__getitem__


@pytest.mark.parametrize("has_scan", [False, True])
def test_things_are_put_where_they_are_with_samples_on_a_disk(
    samples: SampleSet, monkeypatch: Any, has_scan: bool
) -> None:
    def read(drive: CachedDrive, index: int) -> TrainingSample:
        sample = with_poles(drive, index)
        return replace(sample, depth_single_m=sample.depth_m) if has_scan else sample

    monkeypatch.setattr(CachedDrive, "__getitem__", read)
    plain = without_looks(FULL)
    config = replace(plain, copy_paste=0.8)
    mine, theirs = resident(samples, config, (64, 96)), BatchMaker(samples, config, 0).make(8, 6, (64, 96))
    torch.testing.assert_close(mine.image, theirs.image, atol=2.01 / 255, rtol=0)
    names = ("radar", "valid", "depth_accumulated_m", "classes", *(("depth_single_m",) if has_scan else ()))
    for name in names:
        torch.testing.assert_close(getattr(mine, name), getattr(theirs, name), equal_nan=True, rtol=0, atol=0)
    without = resident(samples, plain, (64, 96))
    assert (mine.classes != without.classes).flatten(1).any(1).sum() >= 3
    # What else is drawn of a sample is as it was.
    torch.testing.assert_close(mine.ground, without.ground, rtol=0, atol=0)


def test_a_mirrored_thing_of_one_column_is_pasted() -> None:
    """numpy calls such an array contiguous, and leaves its step backwards as it is."""
    thing = Patch(
        top=1,
        left=2,
        image=np.full((3, 1, 3), 51.0, np.float32),
        alpha=np.ones((3, 1), np.float32),
        depth_m=np.full((3, 1), 4.0, np.float16),
        classes=np.full((3, 1), 11, np.uint8),
    ).mirrored
    image, depth_m, classes = torch.ones(3, 6, 8), torch.full((6, 8), 9.0), torch.zeros(6, 8, dtype=torch.uint8)
    batches._paste(image, depth_m, classes, None, thing)
    there = depth_m == 4.0
    assert there.sum() == 3
    assert (classes[there] == 11).all()
    torch.testing.assert_close(image[:, there], torch.full((3, 3), 0.2))
