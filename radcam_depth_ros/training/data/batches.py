"""Batches of augmented samples, made ahead while the network trains.

Which samples a batch holds and what happens to them is a function of the seed and of how many samples came before:
there is no sampler state, so that a resumed run goes on exactly as it would have.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.geometry import ground_coefficients
from radcam_depth_ros.resampling import use_one_thread
from radcam_depth_ros.training.data.augmentation import AugmentationConfig, augment
from radcam_depth_ros.training.data.copy_paste import Pasting, things_of
from radcam_depth_ros.training.data.order import MixedOrder
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import RADAR_VALUES, TrainingSample
from radcam_depth_ros.training.data.unreadable import unreadable

MadeT = TypeVar("MadeT")

POINTS_MULTIPLE = 16
"""The number of returns of a batch is rounded up to this: few different shapes, so memory is used again."""


@dataclass(frozen=True)
class Batch:
    """What one iteration is given.

    Attributes:
        image: (B, 3, H, W) float32, 0 to 1, channels last in memory.
        radar: (B, N, 6) float32.
        valid: (B, N) bool.
        ground: (B, 4) float32.
        depth_accumulated_m: (B, 1, H, W) float32, NaN unknown, +inf sky: many scans, or the exact depth.
        depth_single_m: The same of a single scan; None where one ground truth serves as both.
        classes: (B, H, W) uint8, 255 unknown.
        readable: (B,) bool, False where a picture was replaced by one that tells nothing of the road.
    """

    image: Tensor
    radar: Tensor
    valid: Tensor
    ground: Tensor
    depth_accumulated_m: Tensor
    depth_single_m: Tensor | None
    classes: Tensor
    readable: Tensor

    def to(self, device: torch.device) -> Batch:
        """The same batch on a device."""
        moved = {
            entry.name: tensor.to(device, non_blocking=True)
            for entry in fields(self)
            if (tensor := getattr(self, entry.name)) is not None
        }
        return replace(self, **moved)


def collate(
    samples: Sequence[TrainingSample],
    images: Sequence[FloatArray] | None = None,
    readable: Sequence[bool] | None = None,
) -> Batch:
    """Samples of one size as a batch.

    Args:
        samples: The samples.
        images: (H, W, 3) float32 images in their place; their own, divided by 255, by default.
        readable: Whether each image tells anything of the road; all do by default.
    """
    if images is None:
        images = [sample.image.astype(np.float32) / np.float32(255) for sample in samples]
    points = max(len(sample.radar) for sample in samples)
    points = max(1, -(-points // POINTS_MULTIPLE)) * POINTS_MULTIPLE
    # Padding is a return at 1 m that is not valid: finite in every formula.
    radar = np.ones((len(samples), points, RADAR_VALUES), np.float32)
    valid = np.zeros((len(samples), points), np.bool_)
    for index, sample in enumerate(samples):
        radar[index, : len(sample.radar)] = sample.radar
        valid[index, : len(sample.radar)] = True
    ground = np.stack([ground_coefficients(sample.ground.or_assumed(), sample.camera) for sample in samples])
    singles = [sample.depth_single_or_only_m for sample in samples]
    differ = any(sample.depth_single_m is not None for sample in samples)
    # All arithmetic is numpy's: a thread that uses torch's gets a team of OpenMP threads of its own, and with more such
    # threads than processors those of the thread that trains stop spinning while they wait.
    return Batch(
        image=torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2),
        radar=torch.from_numpy(radar),
        valid=torch.from_numpy(valid),
        ground=torch.from_numpy(ground),
        depth_accumulated_m=_depths([sample.depth_m for sample in samples]),
        depth_single_m=_depths(singles) if differ else None,
        classes=torch.from_numpy(np.stack([sample.classes for sample in samples])),
        readable=torch.from_numpy(np.array([True] * len(samples) if readable is None else readable)),
    )


def _depths(depths_m: Sequence[npt.NDArray[np.float16]]) -> Tensor:
    """(B, 1, H, W) float32."""
    return torch.from_numpy(np.stack(depths_m).astype(np.float32)[:, None])


class BatchMaker:
    """Makes the batch that begins after a number of samples.

    Args:
        samples: What there is.
        config: Augmentation.
        seed: Of order and augmentation.
        rehearsal: Samples that are mixed in.
        rehearsal_share: Share of these among all.
    """

    def __init__(
        self,
        samples: SampleSet,
        config: AugmentationConfig,
        seed: int,
        rehearsal: SampleSet | None = None,
        rehearsal_share: float = 0.0,
    ) -> None:
        self._samples = samples
        self._config = config
        self._seed = seed
        self._rehearsal = rehearsal
        self._order = MixedOrder(len(samples), seed, len(rehearsal or ()), rehearsal_share)
        # As torch's threads, OpenCV's would take turns with those of the network that trains.
        use_one_thread()

    def make(self, position: int, count: int, size: tuple[int, int]) -> Batch:
        """The batch of the samples number `position` to `position + count`, cropped to `size` (height, width)."""
        samples, images, chances = [], [], []
        for place in range(position, position + count):
            rng = np.random.default_rng((self._seed, 1, place))
            pasting = Pasting.drawn(self._seed, place, self._config.copy_paste, self._config.copy_paste_things)
            donors = () if pasting is None else pasting.donors
            things = [thing for other in donors for thing in things_of(self._sample(other))]
            sample, image = augment(self._sample(place), size, self._config, rng, pasting, things)
            samples.append(sample)
            images.append(image)
            chances.append(rng.spawn(1)[0])
        return collate(samples, *self._pictures(images, chances))

    def grow(self, samples: SampleSet, place: int) -> None:
        """From a place on takes samples of a set that has grown; batches of earlier places may be in the making."""
        self._samples = samples
        self._order.grow(len(samples), place)

    def finish(self, batch: Batch) -> Batch:
        """The batch: nothing is left to do."""
        return batch

    def _pictures(
        self, images: list[FloatArray], chances: list[np.random.Generator]
    ) -> tuple[list[FloatArray], list[bool]]:
        """Replaces some pictures by ones that tell nothing, or by the next sample's; and which tell of the road."""
        pictures, readable = list(images), [True] * len(images)
        for index, rng in enumerate(chances):
            chance = rng.random()
            if chance < self._config.unreadable:
                pictures[index], readable[index] = unreadable(images[index], rng)
            elif chance < self._config.unreadable + self._config.foreign and len(images) > 1:
                pictures[index], readable[index] = images[(index + 1) % len(images)], False
        return pictures, readable

    def _sample(self, place: int) -> TrainingSample:
        is_rehearsal, index = self._order.at(place)
        return (self._rehearsal or self._samples)[index] if is_rehearsal else self._samples[index]


class Maker(Protocol[MadeT]):
    """Makes batches in two steps."""

    def grow(self, samples: SampleSet, place: int) -> None:
        """From a place on takes samples of a set that has grown."""

    def make(self, position: int, count: int, size: tuple[int, int]) -> MadeT:
        """The first step, in another thread."""

    def finish(self, made: MadeT, /) -> Batch:
        """The second step, in the thread that trains."""


def prefetch(
    maker: Maker[MadeT],
    position: int,
    count: int,
    sizes: Sequence[tuple[int, int]],
    pool: ThreadPoolExecutor,
    ahead: int,
    step: int,
) -> Generator[Batch, None, None]:
    """Endless batches from `position` on, one every `step` samples, each of one of the sizes.

    `ahead` of them are in the making in the pool's threads.
    """
    waiting: deque[Future[MadeT]] = deque()
    try:
        while True:
            while len(waiting) < ahead:
                size = sizes[int(np.random.default_rng((3, position // step)).integers(len(sizes)))]
                waiting.append(pool.submit(maker.make, position, count, size))
                position += step
            yield maker.finish(waiting.popleft().result())
    finally:
        for future in waiting:
            future.cancel()
