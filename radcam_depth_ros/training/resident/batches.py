"""Batches of augmented samples whose pixels are on a device: cut, scaled and changed there.

The host draws what an image shows, its returns and its road exactly as for samples on a disk; only light and appearance
have random numbers of their own. A batch is a function of the seed and of how many samples came before, as there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import interpolate, pad

from radcam_depth_ros.training.data.augmentation import AugmentationConfig, told
from radcam_depth_ros.training.data.batches import Batch, collate
from radcam_depth_ros.training.data.copy_paste import Pasting, Patch
from radcam_depth_ros.training.data.order import MixedOrder
from radcam_depth_ros.training.data.sample_sets import SampleSet
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS
from radcam_depth_ros.training.data.views import View, scaled_places
from radcam_depth_ros.training.resident.appearance import develop, restyle
from radcam_depth_ros.training.resident.chances import Chances
from radcam_depth_ros.training.resident.photometric import perceive, unreadable
from radcam_depth_ros.training.resident.store import ResidentSample, ResidentSamples


@dataclass(frozen=True)
class BatchPlan:
    """What a batch is made of: all that the host has to say.

    Attributes:
        samples: Whose pixels it shows.
        views: What it shows of each.
        patches: What is put into each view.
        facts: All of the batch but its pixels.
        position: How many samples came before.
    """

    samples: tuple[ResidentSample, ...]
    views: tuple[View, ...]
    patches: tuple[tuple[Patch, ...], ...]
    facts: Batch
    position: int


class ResidentBatchMaker:
    """Makes the batch that begins after a number of samples.

    Args:
        samples: What there is; read into the device's memory.
        config: Augmentation.
        seed: Of order and augmentation.
        rehearsal: Samples that are mixed in.
        rehearsal_share: Share of these among all.
        device: Where pixels are held and changed.

    Raises:
        TrainingError: when the samples do not fit into the device's memory.
    """

    def __init__(
        self,
        samples: SampleSet,
        config: AugmentationConfig,
        seed: int,
        rehearsal: SampleSet | None,
        rehearsal_share: float,
        device: torch.device,
    ) -> None:
        with_things = config.copy_paste > 0
        self._samples = ResidentSamples(samples, device, with_things)
        self._rehearsal = None if rehearsal is None else ResidentSamples(rehearsal, device, with_things)
        self._config = config
        self._seed = seed
        self._device = device
        self._order = MixedOrder(len(samples), seed, len(rehearsal or ()), rehearsal_share)

    def make(self, position: int, count: int, size: tuple[int, int]) -> BatchPlan:
        """What is in the batch of the samples number `position` to `position + count`; leaves the device alone."""
        samples, views, patches, facts = [], [], [], []
        for place in range(position, position + count):
            rng = np.random.default_rng((self._seed, 1, place))
            sample = self._sample(place)
            view = View.drawn(
                sample.facts.camera, size, self._config.focal_jitter, self._config.mirror, rng, rng.spawn(1)[0]
            )
            samples.append(sample)
            views.append(view)
            seen = view.facts_of(sample.facts)
            added: tuple[Patch, ...] = ()
            pasting = Pasting.drawn(self._seed, place, self._config.copy_paste, self._config.copy_paste_things)
            if pasting is not None:
                things = [thing for other in pasting.donors for thing in self._sample(other).things]
                added, returns = pasting.planned(things, sample.spots, view, sample.facts.camera.fx)
                seen = pasting.with_returns(seen, returns)
            patches.append(added)
            facts.append(told(seen, self._config, rng))
        return BatchPlan(tuple(samples), tuple(views), tuple(patches), collate(facts), position)

    def grow(self, samples: SampleSet, place: int) -> None:
        """From a place on takes samples of a set that has grown; batches of earlier places may be in the making.

        Raises:
            TrainingError: when the new ones do not fit into the device's memory; all is as before then.
        """
        self._samples.grow(samples)
        self._order.grow(len(samples), place)

    def finish(self, plan: BatchPlan) -> Batch:
        """The batch, on the device."""
        chances = Chances((self._seed, 4, plan.position), self._device)
        pairs = list(zip(plan.samples, plan.views, strict=True))
        images = torch.stack([_image(sample.pixels.image[sample.frame], view) for sample, view in pairs])
        depth_m = torch.stack(
            [_nearest(sample.pixels.depth_m[sample.frame], view, torch.nan) for sample, view in pairs]
        )
        classes = torch.stack(
            [_nearest(sample.pixels.classes[sample.frame], view, UNKNOWN_CLASS) for sample, view in pairs]
        )
        single_m = None
        if any(sample.pixels.depth_single_m is not None for sample in plan.samples):
            single_m = torch.stack([_nearest(_single(sample), view, torch.nan) for sample, view in pairs])[
                :, None
            ].float()
        for index, patches in enumerate(plan.patches):
            for patch in patches:
                _paste(
                    images[index],
                    depth_m[index],
                    classes[index],
                    None if single_m is None else single_m[index, 0],
                    patch,
                )
        depth_m = depth_m.float()
        images = restyle(images, depth_m, classes, self._config.appearance, chances)
        images = develop(perceive(images, self._config.photometric, chances), self._config.appearance, chances)
        images, readable = self._replaced(images, chances)
        return replace(
            plan.facts.to(self._device),
            image=images.contiguous(memory_format=torch.channels_last),
            depth_accumulated_m=depth_m[:, None],
            depth_single_m=single_m,
            classes=classes,
            readable=torch.tensor(readable).to(self._device),
        )

    def _replaced(self, images: Tensor, chances: Chances) -> tuple[Tensor, list[bool]]:
        """Replaces some pictures by ones that tell nothing, or by the next sample's; and which tell of the road."""
        chance = chances.host.random(len(images))
        told_little = np.flatnonzero(chance < self._config.unreadable).tolist()
        others = (chance >= self._config.unreadable) & (chance < self._config.unreadable + self._config.foreign)
        foreign = np.flatnonzero(others).tolist() if len(images) > 1 else []
        before = images.clone() if foreign else images
        readable = unreadable(images, told_little, chances)
        for index in foreign:
            images[index], readable[index] = before[(index + 1) % len(images)], False
        return images, readable

    def _sample(self, place: int) -> ResidentSample:
        is_rehearsal, index = self._order.at(place)
        return (self._rehearsal or self._samples)[index] if is_rehearsal else self._samples[index]


def _single(sample: ResidentSample) -> Tensor:
    single_m = sample.pixels.depth_single_m
    return (sample.pixels.depth_m if single_m is None else single_m)[sample.frame]


def _window(values: Tensor, view: View, fill: float) -> Tensor:
    """A window of (H, W, ...), filled where it reaches beyond."""
    part = values[view.top : view.top + view.height, view.left : view.left + view.width]
    below, right = view.height - part.shape[0], view.width - part.shape[1]
    if not below and not right:
        return part
    return pad(part, (*((0, 0) * (values.dim() - 2)), 0, right, 0, below), value=fill)


def _image(image: Tensor, view: View) -> Tensor:
    """(3, h, w) float32, 0 to 1, of (H, W, 3) uint8: scaled linearly, in whole steps of 1 / 255 as on a disk."""
    part = _window(image, view, 0).permute(2, 0, 1).float()
    if part.shape[1:] != view.size:
        part = interpolate(part[None], view.size, mode="bilinear", align_corners=False)[0].round()
    return (part.flip(2) if view.is_mirrored else part) / 255


def _paste(image: Tensor, depth_m: Tensor, classes: Tensor, single_m: Tensor | None, patch: Patch) -> None:
    """Puts a patch into a view (3, h, w) and what is true of it (h, w), as `copy_paste.pasted` does on the host."""
    seen = patch.within(*depth_m.shape)
    if seen is None:
        return
    part, (rows, columns) = seen
    own_image, alpha, own_m, own_classes = (
        torch.from_numpy(array.copy()).to(image.device)
        for array in (part.image, part.alpha, part.depth_m, part.classes)
    )
    there_m, there = depth_m[rows, columns], image[:, rows, columns]
    front = own_m < there_m
    blended = (alpha * own_image.permute(2, 0, 1) + (1 - alpha) * 255 * there).round() / 255
    image[:, rows, columns] = torch.where(front, blended, there)
    classes[rows, columns] = torch.where(front, own_classes, classes[rows, columns])
    if single_m is not None:
        single_m[rows, columns] = torch.where(front, torch.nan, single_m[rows, columns])
    depth_m[rows, columns] = torch.where(front, own_m, there_m)


def _nearest(values: Tensor, view: View, fill: float) -> Tensor:
    """(h, w) of (H, W): each the value of the nearest pixel."""
    part = _window(values, view, fill)
    if part.shape != view.size:
        rows, columns = (
            torch.from_numpy(scaled_places(length, wanted)).to(values.device)
            for length, wanted in zip(part.shape, view.size, strict=True)
        )
        part = part[rows[:, None], columns]
    return part.flip(1) if view.is_mirrored else part
