"""Turns the bags of a run into training data: refuses test drives, holds some out, takes more while it trains."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from radcam_depth_ros.networks import registry
from radcam_depth_ros.storage import is_remote
from radcam_depth_ros.training.data.cache import CacheSettings, cached_drives
from radcam_depth_ros.training.data.growth import Growth
from radcam_depth_ros.training.data.rehearsal import RehearsalConfig, rehearsal_drives
from radcam_depth_ros.training.data.sample_sets import SampleSet, TrainingData
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.data.shared_cache import SharedCache
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.plan import RunPlan

FIRST_TEST_SEED = 1_000_000
"""Simulated drives from this seed on are for measuring; nothing is ever trained or chosen on them."""

LOOK_EVERY_S = 10.0
"""Between two looks for bags that have come."""

OnTask = Callable[[str, int], Callable[[str], None]]
"""Told the name of a task and how many things it has; returns what is called with the name of each that is done."""

Prepare = Callable[[Sequence[Path]], Sequence[CachedDrive]]
"""Makes samples of bags, `cache.cached_drives` with its settings."""


def refuse_test_drives(bags: Sequence[Path]) -> None:
    """Refuses simulated drives that are kept for measuring, as far as their names tell.

    Raises:
        TrainingError: naming the first of them.
    """
    for bag in bags:
        seeds = [int(number) for number in re.findall(r"\d{7,}", bag.stem)]
        if any(FIRST_TEST_SEED <= seed < 10 * FIRST_TEST_SEED for seed in seeds):
            raise TrainingError(
                f"{bag} is a simulated drive with a seed of {FIRST_TEST_SEED} or more; those are kept for measuring: "
                "train on drives with lower seeds"
            )


def cache_settings(plan: RunPlan) -> CacheSettings:
    """What the samples of a run are made with."""
    architecture = registry.create_config(plan.network, plan.config.architecture)
    return CacheSettings(architecture.focal_length_px, architecture.max_depth_m, plan.drive)


def _caches(plan: RunPlan, out: Path) -> tuple[SharedCache | None, Path]:
    """The cache in storage, if there is one, and that on this disk: samples are read in random order, many times."""
    return (SharedCache(plan.cache), out / "cache") if is_remote(plan.cache) else (None, Path(plan.cache))


def load(plan: RunPlan, out: Path, processes: int, on_task: OnTask, on_note: Callable[[str], None]) -> TrainingData:
    """All that a run begins with; samples are prepared, and drives to rehearse simulated, where they are missing.

    Args:
        plan: Of the run.
        out: Its folder.
        processes: Bags that are prepared at once.
        on_task: Told how many bags there are, and given back what is to be called after each.
        on_note: Told what bags lack, a sentence each.

    Raises:
        TrainingError: for bags that cannot be trained on.
        BagError: for bags that cannot be read.
        StorageError: for storage that cannot be read or written.
    """
    recipe, settings = plan.config, cache_settings(plan)
    shared, cache = _caches(plan, out)
    bags, validation_bags, rehearsal_bags = (
        [Path(bag) for bag in group] for group in (plan.bags, plan.validation_bags, plan.rehearsal_bags)
    )
    if recipe.rehearsal.share and not rehearsal_bags:
        on_drive = on_task("simulating drives to rehearse", recipe.rehearsal.drives)
        folder = cache / "rehearsal"
        rehearsal_bags = list(rehearsal_drives(recipe.rehearsal, folder, processes, lambda: on_drive("")))
    on_bag = on_task("samples", len(bags) + len(validation_bags) + len(rehearsal_bags))

    def prepare(bags: Sequence[Path], settings: CacheSettings) -> Sequence[CachedDrive]:
        return cached_drives(bags, cache, settings, processes, lambda bag: on_bag(bag.name), on_note, shared)

    data = load_data(bags, validation_bags, recipe.validation.hold_out, partial(prepare, settings=settings))
    if plan.sources.initial is not None:
        data = replace(data, description=f"{data.description}, from the weights of {Path(plan.sources.initial).stem}")
    if plan.sources.teacher is not None:
        data = replace(data, description=f"{data.description}, taught by {Path(plan.sources.teacher).stem}")
    if rehearsal_bags:
        settings = replace(settings, drive=plan.rehearsed_drive)
        data = with_rehearsal(data, rehearsal_bags, recipe.rehearsal, partial(prepare, settings=settings))
    return data


def growth_of(
    plan: RunPlan, out: Path, processes: int, find: Callable[[], Sequence[str]], on_note: Callable[[str], None]
) -> Growth | None:
    """What finds bags that come while a network trains; None for a run that does not grow.

    Args:
        plan: Of the run.
        out: Its folder.
        processes: Bags that are prepared at once.
        find: All bags that are there now.
        on_note: Told of bags that cannot be learned from, a sentence each.
    """
    if not plan.growing:
        return None
    settings = cache_settings(plan)
    shared, cache = _caches(plan, out)

    def prepare(bags: Sequence[Path]) -> Sequence[CachedDrive]:
        refuse_test_drives(bags)
        return cached_drives(bags, cache, settings, processes, shared=shared)

    return Growth(find, prepare, {*plan.bags, *plan.validation_bags, *plan.rehearsal_bags}, on_note, LOOK_EVERY_S)


def load_data(
    bags: Sequence[Path],
    validation_bags: Sequence[Path],
    hold_out: float,
    prepare: Prepare,
) -> TrainingData:
    """Samples to train and to validate on.

    Args:
        bags: To train on.
        validation_bags: To validate on; when there are none, every so many of `bags` are held out, or the last frames
            of a single one.
        hold_out: Share that is held out.
        prepare: Makes their samples.

    Raises:
        TrainingError: when a bag is in both, is a test drive, or has no ground truth.
    """
    refuse_test_drives([*bags, *validation_bags])
    both = {bag.resolve() for bag in bags} & {bag.resolve() for bag in validation_bags}
    if both:
        raise TrainingError(f"{sorted(both)[0]} is among the training and the validation bags; take it out of one")
    if not validation_bags and len(bags) > 1:
        # Evenly over the list: bags are often sorted by place or weather.
        every = max(2, round(1 / hold_out))
        validation_bags = bags[every // 2 :: every] or bags[-1:]
        bags = [bag for bag in bags if bag not in validation_bags]
    drives = prepare([*bags, *validation_bags])
    train = SampleSet.of(drives[: len(bags)])
    if validation_bags:
        validation = SampleSet.of(drives[len(bags) :])
    else:
        train, validation = train.split(hold_out)
    names = ", ".join(sorted({bag.parent.name if bag.is_file() else bag.name for bag in bags})[:4])
    description = f"{len(train)} frames of {len(bags)} bags ({names})"
    return TrainingData(train, validation, description)


def with_rehearsal(
    data: TrainingData,
    bags: Sequence[Path],
    config: RehearsalConfig,
    prepare: Prepare,
) -> TrainingData:
    """The same data with bags to rehearse, of which the last are held out to see what is forgotten.

    Args:
        data: To train on besides.
        bags: To rehearse.
        config: How much is held out.
        prepare: Makes their samples.
    """
    refuse_test_drives(bags)
    drives = prepare(bags)
    if len(drives) > 1:
        last = max(1, round(config.hold_out * len(drives)))
        train, validation = SampleSet.of(drives[:-last]), SampleSet.of(drives[-last:])
    else:
        train, validation = SampleSet.of(drives).split(config.hold_out)
    description = f"{data.description}, rehearsing {len(train)} frames as {100 * config.share:.0f} % of all"
    return replace(data, rehearsal=train, rehearsal_validation=validation, description=description)
