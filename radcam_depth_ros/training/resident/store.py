"""Holds the pixels of samples in the device's memory, as uint8 and float16, and what else they have on the host."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.training.data.copy_paste import Thing, spots_of, things_of
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import CachedDrive, TrainingSample
from radcam_depth_ros.training.errors import TrainingError

_Facts = tuple[TrainingSample, tuple[Thing, ...], FloatArray]
_RESERVE = 0.4
"""Share of a device's free memory that is left to the network and its gradients."""


@dataclass(frozen=True)
class DrivePixels:
    """The pixels of a drive, on a device.

    Attributes:
        image: (F, H, W, 3) uint8 RGB.
        depth_m: (F, H, W) float16 metres, NaN unknown, +inf sky.
        classes: (F, H, W) uint8, 255 unknown.
        depth_single_m: (F, H, W) float16 of a single scan; None where no frame has one.
    """

    image: Tensor
    depth_m: Tensor
    classes: Tensor
    depth_single_m: Tensor | None


@dataclass(frozen=True)
class ResidentSample:
    """A sample whose pixels are on a device.

    Attributes:
        pixels: Of its drive.
        frame: Its number in the drive.
        facts: What else there is: camera, returns, road. Its arrays of pixels are empty.
        things: What can be copied out of it, on the host; none where nothing is to be.
        spots: Where things can be put, see `copy_paste.spots_of`.
    """

    pixels: DrivePixels
    frame: int
    facts: TrainingSample
    things: tuple[Thing, ...]
    spots: FloatArray


class ResidentSamples:
    """The samples of a set, read once.

    Args:
        samples: The set.
        device: Where their pixels are to be.
        with_things: Whether things are to be copied between them.

    Raises:
        TrainingError: when they are larger than the device's memory allows; nothing is read then.
    """

    def __init__(self, samples: SampleSet, device: torch.device, with_things: bool = False) -> None:
        self._device = device
        self._with_things = with_things
        self._pixels: list[DrivePixels] = []
        self._facts: list[list[_Facts]] = []
        self.grow(samples)

    def grow(self, samples: SampleSet) -> None:
        """Takes a set whose first drives are those that are held already; the others are read.

        Raises:
            TrainingError: when these are larger than the device's memory allows; nothing is read then.
        """
        drives = samples.drives[len(self._pixels) :]
        self._require_room(drives)
        for drive in drives:
            self._read(drive)
        self._entries = samples.entries

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, index: int) -> ResidentSample:
        drive, frame = (int(value) for value in self._entries[index])
        return ResidentSample(self._pixels[drive], frame, *self._facts[drive][frame])

    def _require_room(self, drives: tuple[CachedDrive, ...]) -> None:
        if self._device.type != "cuda":
            return
        wanted = sum(drive.pixel_bytes for drive in drives)
        free, _ = torch.cuda.mem_get_info(self._device)
        if wanted > (1 - _RESERVE) * free:
            raise TrainingError(
                f"the samples take {wanted / 2**30:.1f} GiB, and the device has {free / 2**30:.1f} GiB free, of which "
                f"{100 * _RESERVE:.0f} % are for the network; set samples: disk in the recipe, or train on fewer bags"
            )

    def _read(self, drive: CachedDrive) -> None:
        samples = [drive[frame] for frame in range(len(drive))]
        single_m = None
        if any(sample.depth_single_m is not None for sample in samples):
            single_m = self._moved([sample.depth_single_or_only_m for sample in samples])
        self._pixels.append(
            DrivePixels(
                self._moved([sample.image for sample in samples]),
                self._moved([sample.depth_m for sample in samples]),
                self._moved([sample.classes for sample in samples]),
                single_m,
            )
        )
        self._facts.append([self._known_of(sample) for sample in samples])

    def _known_of(self, sample: TrainingSample) -> _Facts:
        if not self._with_things:
            return _without_pixels(sample), (), np.zeros((0, 4), np.float32)
        return _without_pixels(sample), things_of(sample), spots_of(sample)

    def _moved(self, arrays: Sequence[npt.NDArray[Any]]) -> Tensor:
        return torch.from_numpy(np.stack(arrays)).to(self._device)


def _without_pixels(sample: TrainingSample) -> TrainingSample:
    return replace(
        sample,
        image=np.zeros((0, 0, 3), np.uint8),
        depth_m=np.zeros((0, 0), np.float16),
        classes=np.zeros((0, 0), np.uint8),
        # Views of what was read keep all of it.
        radar=sample.radar.copy(),
        radar_source=sample.radar_source.copy(),
        depth_single_m=None,
    )
