"""Puts things of one sample onto the ground of another: copy and paste ([Ghiasi2021]), with depth.

People, cycles, poles and signs are few, and a network that has seen few takes them for what is behind. A thing is cut
out where it stands free on the ground and put where the other sample's ground is, scaled by how much nearer or farther
that is, so that it stands there as if it had been recorded: depths, classes and returns follow, and what is nearer
stays in front of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.classes import CLASS_NAMES
from radcam_depth_ros.frame import FloatArray, ImageArray
from radcam_depth_ros.training.data.samples import RADAR_VALUES, UNKNOWN_CLASS, TrainingSample
from radcam_depth_ros.training.data.views import View

_U, _V, _DEPTH = range(3)
KINDS = (("person",), ("rider", "bicycle", "motorcycle"), ("pole", "traffic light", "traffic sign"))
"""What is copied: classes that hang together are one thing."""

_GROUND = ("road", "sidewalk", "terrain")
_GROUND_KIND = len(KINDS)


def _kind_of_class() -> npt.NDArray[np.uint8]:
    """(256,) of a class its kind, `_GROUND_KIND`, or 255."""
    table = np.full(256, 255, np.uint8)
    for kind, names in enumerate((*KINDS, _GROUND)):
        table[[CLASS_NAMES.index(name) for name in names]] = kind
    return table


_KIND_OF_CLASS = _kind_of_class()
_LEAST_AREA_PX, _LEAST_HEIGHT_PX = 60, 10
_LARGEST_SPREAD = 1.5
"""A thing whose farthest pixel is farther than this times its nearest is several things."""

_FOOT_TOLERANCE = 0.1
_SCALES = (0.35, 1.6)
"""Of the pixels of a thing: enlarged more it would be soft where all else is sharp."""

_GAINS = (0.35, 2.5)
_GRID_PX = 6
_DONORS, _DONORS_AHEAD = 3, 1000
_NEAREST_SPOTS = 16


@dataclass(frozen=True)
class Thing:
    """What is cut out of a sample.

    Attributes:
        image: (h, w, 3) uint8 RGB.
        depth_m: (h, w) float16 metres; NaN where the thing is not.
        classes: (h, w) uint8, 255 where the thing is not.
        foot: (u, v) where it stands: the middle of its lowest row, relative to its first pixel.
        foot_m: Depth of the ground there.
        brightness: Mean of the image there, 0 to 255.
        focal_px: Focal length of the image that it is from.
        radar: (n, 6) float32 its returns, as of a sample, with u and v relative to its first pixel.
        kind: Index into `KINDS`.
    """

    image: ImageArray
    depth_m: npt.NDArray[np.float16]
    classes: npt.NDArray[np.uint8]
    foot: tuple[float, float]
    foot_m: float
    brightness: float
    focal_px: float
    radar: FloatArray
    kind: int


@dataclass(frozen=True)
class Patch:
    """A thing as it is put into a view.

    Attributes:
        top: Row of its first pixel; it may begin or end beyond the view.
        left: Its column.
        image: (h, w, 3) float32 RGB, 0 to 255.
        alpha: (h, w) float32, how much of a pixel it covers; 0 where `depth_m` is NaN.
        depth_m: (h, w) float16 metres.
        classes: (h, w) uint8.
    """

    top: int
    left: int
    image: FloatArray
    alpha: FloatArray
    depth_m: npt.NDArray[np.float16]
    classes: npt.NDArray[np.uint8]

    @property
    def mirrored(self) -> Patch:
        """The same with left and right exchanged, in its place."""
        return Patch(
            self.top,
            self.left,
            self.image[:, ::-1],
            self.alpha[:, ::-1],
            self.depth_m[:, ::-1],
            self.classes[:, ::-1],
        )

    def within(self, height: int, width: int) -> tuple[Patch, tuple[slice, slice]] | None:
        """The part of it that lies in a view of this size, and where; None where nothing does."""
        rows = slice(max(self.top, 0), min(self.top + self.alpha.shape[0], height))
        columns = slice(max(self.left, 0), min(self.left + self.alpha.shape[1], width))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return None
        own = (
            slice(rows.start - self.top, rows.stop - self.top),
            slice(columns.start - self.left, columns.stop - self.left),
        )
        part = Patch(rows.start, columns.start, self.image[own], self.alpha[own], self.depth_m[own], self.classes[own])
        return part, (rows, columns)


def things_of(sample: TrainingSample) -> tuple[Thing, ...]:
    """All things that stand free on the ground; none where classes are unknown."""
    kinds = cv2.LUT(sample.classes, _KIND_OF_CLASS)
    found: list[Thing] = []
    for kind in range(len(KINDS)):
        mask = (kinds == kind).astype(np.uint8)
        if not mask.any():
            continue
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
        for label in range(1, count):
            left, top, width, height, area = (int(value) for value in boxes[label])
            if area < _LEAST_AREA_PX or height < _LEAST_HEIGHT_PX:
                continue
            # Cut off by the image's border.
            if left == 0 or left + width == mask.shape[1] or top + height + 2 >= mask.shape[0]:
                continue
            box = (slice(top, top + height), slice(left, left + width))
            thing = _cut(sample, labels[box] == label, box, kind)
            if thing is not None:
                found.append(thing)
    return tuple(found)


def _cut(
    sample: TrainingSample,
    mask: npt.NDArray[np.bool_],
    box: tuple[slice, slice],
    kind: int,
) -> Thing | None:
    """The thing of a mask in a box, or None where it does not stand free on the ground or is several."""
    rows, columns = box
    depth_m = sample.depth_m[box].astype(np.float32)
    mask = mask & np.isfinite(depth_m)
    lowest = np.flatnonzero(mask[-1])
    if not len(lowest):
        return None
    low, high = np.percentile(depth_m[mask], (2, 98))
    below = (slice(rows.stop, rows.stop + 2), slice(columns.start + lowest[0], columns.start + lowest[-1] + 1))
    under_m = sample.depth_m[below].astype(np.float32)
    free = np.isfinite(under_m) & (_KIND_OF_CLASS[sample.classes[below]] == _GROUND_KIND)
    if high > _LARGEST_SPREAD * low or 2 * np.count_nonzero(free) < free.size:
        return None
    foot_m = float(np.median(under_m[free]))
    if abs(float(np.median(depth_m[-1, lowest])) - foot_m) > _FOOT_TOLERANCE * foot_m:
        return None
    radar = sample.radar
    at, u = radar[:, _DEPTH], radar[:, _U] - columns.start
    own = radar[(u >= 0) & (u < mask.shape[1]) & (at > low - 0.5) & (at < high + 0.5)].copy()
    own[:, _U] -= columns.start
    own[:, _V] -= rows.start
    # Copies: a view would keep the whole sample.
    return Thing(
        sample.image[box].copy(),
        np.where(mask, sample.depth_m[box], np.float16(np.nan)),
        np.where(mask, sample.classes[box], np.uint8(UNKNOWN_CLASS)),
        (float(lowest.mean()), mask.shape[0] - 1.0),
        foot_m,
        float(sample.image[below].mean()),
        sample.camera.fx,
        own,
        kind,
    )


def spots_of(sample: TrainingSample) -> FloatArray:
    """(N, 4) float32 places on the ground: u px, v px, depth m, brightness of the image, 0 to 255."""
    part = (slice(_GRID_PX // 2, None, _GRID_PX),) * 2
    depth_m = sample.depth_m[part].astype(np.float32)
    free = np.isfinite(depth_m) & (_KIND_OF_CLASS[sample.classes[part]] == _GROUND_KIND)
    rows, columns = np.nonzero(free)
    places = [columns * _GRID_PX + _GRID_PX // 2, rows * _GRID_PX + _GRID_PX // 2]
    return np.stack([*places, depth_m[free], sample.image[part][free].mean(axis=1)], axis=1).astype(np.float32)


@dataclass(frozen=True)
class Pasting:
    """What is to be put onto the ground of a sample: a function of the seed and of the sample's place in the order.

    Attributes:
        donors: Places of other samples, whose things are taken.
        most: Greatest number of things; how many is drawn.
        rng: Where all randomness comes from.
    """

    donors: tuple[int, ...]
    most: int
    rng: np.random.Generator

    @classmethod
    def drawn(cls, seed: int, place: int, share: float, most: int) -> Pasting | None:
        """That of a place, None where nothing is put there; `share` of the places have some."""
        # A generator of its own: switching this on or off changes nothing else of a sample.
        rng = np.random.default_rng((seed, 5, place))
        if rng.random() >= share:
            return None
        return cls(tuple(place + 1 + int(ahead) for ahead in rng.integers(0, _DONORS_AHEAD, _DONORS)), most, rng)

    def planned(
        self, things: Sequence[Thing], spots: FloatArray, view: View, focal_px: float
    ) -> tuple[tuple[Patch, ...], FloatArray]:
        """Puts things on the ground of a view, each at a place of its own.

        Args:
            things: Of the donors.
            spots: Of the sample that is seen, see `spots_of`.
            view: What is seen of it.
            focal_px: The sample's focal length.

        Returns:
            The patches, the farthest first, and their returns (n, 6) in the view.
        """
        spots = _seen(spots, view)
        placed: list[tuple[float, Patch]] = []
        returns = [np.zeros((0, RADAR_VALUES), np.float32)]
        kinds = sorted({thing.kind for thing in things})
        for _ in range(int(self.rng.integers(1, self.most + 1)) if kinds and len(spots) else 0):
            # Poles are many, people few.
            kind = kinds[int(self.rng.integers(len(kinds)))]
            alike = [thing for thing in things if thing.kind == kind]
            thing = alike[int(self.rng.integers(len(alike)))]
            spot = _spot(thing, spots, focal_px, self.rng)
            mirrored = bool(self.rng.random() < 0.5)
            if spot is not None:
                patch, radar = _put(thing, spot, view, focal_px, mirrored)
                placed.append((float(spot[_DEPTH]), patch))
                returns.append(radar)
        placed.sort(key=lambda entry: -entry[0])
        return tuple(patch for _, patch in placed), np.concatenate(returns)

    def with_returns(self, sample: TrainingSample, radar: FloatArray) -> TrainingSample:
        """A view with the returns of patches, as if one of its radars had measured them."""
        if not len(radar):
            return sample
        radars = np.unique(sample.radar_source) if len(sample.radar_source) else np.zeros(1, np.uint8)
        source = np.full(len(radar), self.rng.choice(radars), np.uint8)
        return replace(
            sample,
            radar=np.concatenate([sample.radar, radar]),
            radar_source=np.concatenate([sample.radar_source, source]),
        )


def _seen(spots: FloatArray, view: View) -> FloatArray:
    """Those places that lie in a view."""
    u, v = view.places(spots[:, _U], spots[:, _V])
    height, width = view.size
    return spots[(u >= 0) & (u < width) & (v >= 0) & (v < height)]


def _spot(thing: Thing, spots: FloatArray, focal_px: float, rng: np.random.Generator) -> FloatArray | None:
    """A place at which a thing has a size that it may have: near and far places, by the logarithm, alike often."""
    scale = thing.foot_m / spots[:, _DEPTH] * focal_px / thing.focal_px
    fitting = spots[(scale > _SCALES[0]) & (scale < _SCALES[1])]
    chance, which = rng.random(), rng.random()
    if not len(fitting):
        return None
    depth = np.log(fitting[:, _DEPTH])
    wanted = depth.min() + chance * (depth.max() - depth.min())
    nearest = np.argsort(np.abs(depth - wanted), kind="stable")[:_NEAREST_SPOTS]
    return np.asarray(fitting[nearest[int(which * len(nearest))]])


def _put(thing: Thing, spot: FloatArray, view: View, focal_px: float, mirrored: bool) -> tuple[Patch, FloatArray]:
    """A thing at a place."""
    nearer = float(thing.foot_m / spot[_DEPTH])
    scale = nearer * focal_px / thing.focal_px * view.scale
    height, width = thing.classes.shape
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    x, y = size[0] / width, size[1] / height
    at_u, at_v = view.places(spot[_U : _U + 1], spot[_V : _V + 1])
    foot_u = (thing.foot[0] + 0.5) * x - 0.5
    if mirrored:
        foot_u = size[0] - 1 - foot_u
    left, top = round(float(at_u[0]) - foot_u), round(float(at_v[0])) - (size[1] - 1)
    gain = float(np.clip((spot[3] + 4) / (thing.brightness + 4), *_GAINS))
    rows = ((np.arange(size[1]) + 0.5) / y).astype(np.int64)[:, None]
    columns = ((np.arange(size[0]) + 0.5) / x).astype(np.int64)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    inside = (thing.classes != UNKNOWN_CLASS).astype(np.float32)
    image = cv2.resize(thing.image, size, interpolation=method).reshape(size[1], size[0], 3)
    alpha = cv2.resize(inside, size, interpolation=method).reshape(size[1], size[0])
    depth_m = (thing.depth_m[rows, columns].astype(np.float32) / nearer).astype(np.float16)
    covered = np.where(np.isnan(depth_m), np.float32(0), np.maximum(alpha, np.float32(0.5)))
    lit = np.clip(image.astype(np.float32) * np.float32(gain), 0, 255)
    patch = Patch(top, left, lit, covered, depth_m, thing.classes[rows, columns])
    radar = thing.radar.copy()
    radar[:, _U] = (radar[:, _U] + 0.5) * x - 0.5
    if mirrored:
        patch = patch.mirrored
        radar[:, _U] = size[0] - 1 - radar[:, _U]
    radar[:, _U] += left
    radar[:, _V] = (radar[:, _V] + 0.5) * y - 0.5 + top
    radar[:, _DEPTH] /= nearer
    return patch, radar


def pasted(sample: TrainingSample, patches: Sequence[Patch]) -> TrainingSample:
    """A view with patches in it: each where it is nearer than what is there; pixels of unknown depth stay."""
    if not patches:
        return sample
    image, depth_m, classes = sample.image.copy(), sample.depth_m.copy(), sample.classes.copy()
    single_m = None if sample.depth_single_m is None else sample.depth_single_m.copy()
    for patch in patches:
        seen = patch.within(*depth_m.shape)
        if seen is None:
            continue
        part, place = seen
        front = part.depth_m < depth_m[place]
        alpha = part.alpha[..., None]
        blended = alpha * part.image + (1 - alpha) * image[place]
        image[place] = np.where(front[..., None], np.rint(blended), image[place]).astype(np.uint8)
        depth_m[place] = np.where(front, part.depth_m, depth_m[place])
        classes[place] = np.where(front, part.classes, classes[place])
        if single_m is not None:
            # No scan met it.
            single_m[place] = np.where(front, np.float16(np.nan), single_m[place])
    return replace(sample, image=image, depth_m=depth_m, classes=classes, depth_single_m=single_m)
