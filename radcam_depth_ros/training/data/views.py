"""What is seen of a sample: a window of its image, at another focal length, left and right exchanged.

Image, depth, classes, returns and road change together, so that all stays true.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray
from radcam_depth_ros.training.data.samples import UNKNOWN_CLASS, TrainingSample

_U, _V = 0, 1
CROP_MARGIN_PX = 80
"""Half of the width of a return's region of interest, as of `baff`."""

ValueT = TypeVar("ValueT", bound=np.generic)


@dataclass(frozen=True)
class View:
    """What a crop shows of an image.

    Attributes:
        top: First row of the window; it may reach beyond the image.
        left: Its first column.
        height: Its rows.
        width: Its columns.
        size: (height, width) that the window is scaled to.
        is_mirrored: Whether left and right are exchanged.
    """

    top: int
    left: int
    height: int
    width: int
    size: tuple[int, int]
    is_mirrored: bool

    @classmethod
    def drawn(
        cls,
        camera: CameraModel,
        size: tuple[int, int],
        focal_jitter: float,
        mirror: float,
        rng: np.random.Generator,
        look: np.random.Generator,
    ) -> View:
        """A random one of `size`.

        Args:
            camera: Of the image.
            size: (height, width) of the crop.
            focal_jitter: Largest change of the logarithm of the focal length.
            mirror: Probability of a left-right flip.
            rng: Draws the window and the flip.
            look: Draws the focal length.
        """
        height, width = _window_size(camera, size, focal_jitter, look)
        top, left = _offset(camera.height, height, rng), _offset(camera.width, width, rng)
        return cls(top, left, height, width, size, bool(rng.random() < mirror))

    @property
    def scale(self) -> float:
        """Pixels of the crop by those of the image."""
        return self.size[1] / self.width

    def places(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows in the crop of an image's pixels."""
        height, width = self.size
        column = (u - self.left + 0.5) * (width / self.width) - 0.5
        row = (v - self.top + 0.5) * (height / self.height) - 0.5
        return width - 1 - column if self.is_mirrored else column, row

    def of(self, sample: TrainingSample) -> TrainingSample:
        """What is seen of a sample, and what is true of it."""
        result = crop(sample, self.top, self.left, self.height, self.width)
        if (self.height, self.width) != self.size:
            result = zoom(result, self.size)
        return mirrored(result) if self.is_mirrored else result

    def facts_of(self, sample: TrainingSample) -> TrainingSample:
        """The same but for the pixels, which stay as they are."""
        result = _cropped(sample, self.top, self.left, self.height, self.width)
        if (self.height, self.width) != self.size:
            result = _zoomed(result, self.size)
        return _mirrored(result) if self.is_mirrored else result


def crop(sample: TrainingSample, top: int, left: int, height: int, width: int) -> TrainingSample:
    """Cuts a window out; where it reaches beyond the image, the image is black and nothing else is known.

    Returns stay, whatever their row, as radars know little of height, when their column is near enough to the window
    that their region of interest reaches into it; `estimator.radar_columns` keeps such ones, too.
    """
    single_m = sample.depth_single_m
    return replace(
        _cropped(sample, top, left, height, width),
        image=_window(sample.image, top, left, height, width, 0),
        depth_m=_window(sample.depth_m, top, left, height, width, np.nan),
        classes=_window(sample.classes, top, left, height, width, UNKNOWN_CLASS),
        depth_single_m=None if single_m is None else _window(single_m, top, left, height, width, np.nan),
    )


def _cropped(sample: TrainingSample, top: int, left: int, height: int, width: int) -> TrainingSample:
    """Camera and returns of `crop`."""
    old = sample.camera
    radar = sample.radar.copy()
    radar[:, _U] -= left
    radar[:, _V] -= top
    inside = (radar[:, _U] > -CROP_MARGIN_PX) & (radar[:, _U] < width - 1 + CROP_MARGIN_PX)
    return replace(
        sample,
        radar=radar[inside],
        radar_source=sample.radar_source[inside],
        camera=CameraModel(width, height, old.fx, old.fy, old.cx - left, old.cy - top),
    )


def zoom(sample: TrainingSample, size: tuple[int, int]) -> TrainingSample:
    """Scales the image to `size` (height, width): as another focal length has it, since depths stay.

    Depths and classes are taken from the nearest pixel, never blended.
    """
    height, width = size
    rows, columns = scaled_places(sample.camera.height, height), scaled_places(sample.camera.width, width)
    return replace(
        _zoomed(sample, size),
        image=cv2.resize(np.ascontiguousarray(sample.image), (width, height), interpolation=cv2.INTER_LINEAR),
        depth_m=sample.depth_m[rows[:, None], columns],
        classes=sample.classes[rows[:, None], columns],
        depth_single_m=None if sample.depth_single_m is None else sample.depth_single_m[rows[:, None], columns],
    )


def scaled_places(length: int, wanted: int) -> npt.NDArray[np.int64]:
    """(wanted,) of `length` rows or columns the ones that are nearest to those of a scaled image."""
    return ((np.arange(wanted) + 0.5) / (wanted / length)).astype(np.int64)


def _zoomed(sample: TrainingSample, size: tuple[int, int]) -> TrainingSample:
    """Camera and returns of `zoom`."""
    height, width = size
    old = sample.camera
    x, y = width / old.width, height / old.height
    radar = sample.radar.copy()
    radar[:, _U] = (radar[:, _U] + 0.5) * x - 0.5
    radar[:, _V] = (radar[:, _V] + 0.5) * y - 0.5
    # A pixel's coordinates are those of its middle.
    camera = CameraModel(width, height, old.fx * x, old.fy * y, (old.cx + 0.5) * x - 0.5, (old.cy + 0.5) * y - 0.5)
    return replace(sample, radar=radar, camera=camera)


def mirrored(sample: TrainingSample) -> TrainingSample:
    """The same street with left and right exchanged: images, principal point, returns and the road's normal."""
    return replace(
        _mirrored(sample),
        image=sample.image[:, ::-1],
        depth_m=sample.depth_m[:, ::-1],
        classes=sample.classes[:, ::-1],
        depth_single_m=None if sample.depth_single_m is None else sample.depth_single_m[:, ::-1],
    )


def _mirrored(sample: TrainingSample) -> TrainingSample:
    """Camera, returns and road of `mirror`."""
    last = sample.camera.width - 1
    radar = sample.radar.copy()
    radar[:, _U] = last - radar[:, _U]
    up_x, up_y, up_z = sample.ground.up
    return replace(
        sample,
        radar=radar,
        camera=replace(sample.camera, cx=last - sample.camera.cx),
        ground=replace(sample.ground, up=(-up_x, up_y, up_z)),
    )


def _window_size(
    camera: CameraModel, size: tuple[int, int], jitter: float, rng: np.random.Generator
) -> tuple[int, int]:
    """Height and width of the window that becomes `size` at another focal length; never more than the image has."""
    if not jitter:
        return size
    least = max(size[0] / camera.height, size[1] / camera.width)
    scale = max(float(np.exp(rng.uniform(-jitter, jitter))), min(least, 1.0))
    return round(size[0] / scale), round(size[1] / scale)


def _offset(length: int, wanted: int, rng: np.random.Generator) -> int:
    """Where a window begins; at 0 when it does not fit."""
    position = rng.random()
    return int(position * (max(length - wanted, 0) + 1))


def _window(
    values: npt.NDArray[ValueT], top: int, left: int, height: int, width: int, fill: float
) -> npt.NDArray[ValueT]:
    part = values[top : top + height, left : left + width]
    if part.shape[:2] == (height, width):
        return part
    result = np.full((height, width, *values.shape[2:]), fill, values.dtype)
    result[: part.shape[0], : part.shape[1]] = part
    return result
