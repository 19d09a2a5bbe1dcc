"""Frames of several drives under one index, and what a network is trained and judged on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.training.data.samples import CachedDrive, TrainingSample
from radcam_depth_ros.training.errors import TrainingError


@dataclass(frozen=True)
class SampleSet:
    """Frames of several drives under one index.

    Attributes:
        drives: The drives.
        entries: (S, 2) int64: drive and frame of each sample.
    """

    drives: tuple[CachedDrive, ...]
    entries: npt.NDArray[np.int64]

    def __post_init__(self) -> None:
        if not len(self.entries):
            raise TrainingError("there is no frame with ground truth to train or validate on; give more bags")

    @classmethod
    def of(cls, drives: Sequence[CachedDrive]) -> SampleSet:
        """All frames of some drives."""
        entries = [(drive, frame) for drive, cached in enumerate(drives) for frame in range(len(cached))]
        return cls(tuple(drives), np.array(entries, np.int64).reshape(-1, 2))

    def __len__(self) -> int:
        return len(self.entries)

    def grown(self, drives: Sequence[CachedDrive]) -> SampleSet:
        """The same, and all frames of some more drives after them."""
        more = SampleSet.of(drives).entries + np.array([len(self.drives), 0])
        return SampleSet((*self.drives, *drives), np.concatenate([self.entries, more]))

    def __getitem__(self, index: int) -> TrainingSample:
        drive, frame = (int(value) for value in self.entries[index])
        return self.drives[drive][frame]

    @property
    def largest(self) -> tuple[int, int]:
        """Greatest height and width of any image."""
        cameras = [drive.card.camera for drive in self.drives]
        return max(camera.height for camera in cameras), max(camera.width for camera in cameras)

    def split(self, share: float) -> tuple[SampleSet, SampleSet]:
        """The first frames, and the last `share` of them (at least one)."""
        last = min(max(1, round(share * len(self))), len(self))
        return SampleSet(self.drives, self.entries[:-last]), SampleSet(self.drives, self.entries[-last:])

    def spread(self, count: int) -> tuple[int, ...]:
        """Indices of `count` samples, evenly over all."""
        return tuple(np.unique(np.linspace(0, len(self) - 1, min(count, len(self))).round().astype(int)).tolist())


@dataclass(frozen=True)
class TrainingData:
    """What is trained and judged on.

    Attributes:
        train: Samples to train on.
        validation: Held-out samples.
        description: What the archive's card says of the data.
        rehearsal: Samples of a former training, which are mixed in.
        rehearsal_validation: Held-out samples of these.
    """

    train: SampleSet
    validation: SampleSet
    description: str
    rehearsal: SampleSet | None = None
    rehearsal_validation: SampleSet | None = None

    @property
    def largest(self) -> tuple[int, int]:
        """Height and width that some image of each kind has: larger crops would show nothing there."""
        sizes = [samples.largest for samples in (self.train, self.rehearsal) if samples is not None]
        return min(height for height, _ in sizes), min(width for _, width in sizes)
