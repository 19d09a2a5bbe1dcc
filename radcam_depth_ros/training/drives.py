"""Finds bags, refuses test drives and holds some out for validation."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from radcam_depth_ros.training.data.batches import SampleSet
from radcam_depth_ros.training.data.rehearsal import RehearsalConfig
from radcam_depth_ros.training.data.samples import CachedDrive
from radcam_depth_ros.training.errors import TrainingError
from radcam_depth_ros.training.fit import TrainingData

FIRST_TEST_SEED = 1_000_000
"""Simulated drives from this seed on are for measuring; nothing is ever trained or chosen on them."""

Prepare = Callable[[Sequence[Path]], Sequence[CachedDrive]]
"""Makes samples of bags, `cache.cached_drives` with its settings."""

_BAG_SUFFIXES = (".mcap", ".db3")


def find_bags(paths: Sequence[Path]) -> tuple[Path, ...]:
    """All bags in some places, sorted by path, each once.

    Args:
        paths: Bag files, bag folders, or folders with any of these below.

    Raises:
        TrainingError: for a path without a bag.
    """
    found: dict[Path, Path] = {}
    for path in paths:
        bags = _bags_below(path)
        if not bags:
            raise TrainingError(
                f"there is no bag at {path}; give .mcap files, rosbag2 folders, or a folder that holds some"
            )
        found.update((bag.resolve(), bag) for bag in bags)
    return tuple(sorted(found.values()))


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


def _bags_below(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix in _BAG_SUFFIXES else []
    if (path / "metadata.yaml").is_file():
        return [path]
    bags: list[Path] = []
    for child in sorted(path.iterdir()) if path.is_dir() else []:
        # What is hidden is somebody's unfinished work.
        if child.name.startswith("."):
            continue
        bags += _bags_below(child)
    return bags
