"""Resamples published images to the network's size, rectified, and the network's maps to the camera's size."""

from __future__ import annotations

import array
import functools
from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray, Lens
from radcam_depth_ros.geometry import CanonicalCamera

ValueT = TypeVar("ValueT", np.float32, np.uint8)

_ROUNDING_PX = 1e-3


def rectify(image: ImageArray, camera: CameraModel, lens: Lens | None) -> ImageArray:
    """Makes an image ideal at its own size: without distortion, rotated by R, with the intrinsics of its camera.

    Args:
        image: (H, W, 3) uint8 as published.
        camera: The ideal camera.
        lens: How the image differs from that camera's.

    Returns:
        (H, W, 3) uint8, black where the camera saw nothing; the image itself, not a copy, where there is no lens.
    """
    return image if lens is None else resample_image(image, CanonicalCamera(camera, camera, camera), lens)


def use_one_thread() -> None:
    """Keeps OpenCV, in this process, to the thread that calls it: its own would take turns with the network's."""
    cv2.setNumThreads(1)


def resample_image(image: ImageArray, plan: CanonicalCamera, lens: Lens | None = None) -> ImageArray:
    """Rectifies, scales and pads an image for the network, without a rectified image of its own size in between.

    Args:
        image: (H, W, 3) uint8 as published, at the size of `plan.source`.
        plan: The plan.
        lens: How the image differs from the camera's; None where it does not.

    Returns:
        (H', W', 3) uint8, contiguous, at the size of `plan.network`; black where the camera saw nothing; the padding
        repeats the last row and column.
    """
    # A remap looks at 2 x 2 pixels, so most of the shrinking is done before it: whole factors are averaged fast.
    factor = max(1, round(min(plan.source.width / plan.scaled.width, plan.source.height / plan.scaled.height)))
    height, width = plan.source.height // factor, plan.source.width // factor
    if factor > 1:
        whole = image[: height * factor, : width * factor]
        image = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    if lens is None and (height * factor, width * factor) == (plan.source.height, plan.source.width):
        return _scale_and_pad(image, plan)
    resampled: ImageArray = cv2.remap(image, *_maps(plan, lens, factor), cv2.INTER_LINEAR)
    return resampled


def _scale_and_pad(image: ImageArray, plan: CanonicalCamera) -> ImageArray:
    """The result of the remap for a whole image of an ideal camera, in half the time."""
    scaled, network = plan.scaled, plan.network
    image = cv2.resize(image, (scaled.width, scaled.height), interpolation=cv2.INTER_LINEAR)
    rows, columns = network.height - scaled.height, network.width - scaled.width
    padded: ImageArray = cv2.copyMakeBorder(image, 0, rows, 0, columns, cv2.BORDER_REPLICATE)
    return padded


@functools.lru_cache(maxsize=8)
def _maps(plan: CanonicalCamera, lens: Lens | None, factor: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Of each of the network's pixels, where it lies in the published image after shrinking by a whole factor.

    They are OpenCV's fixed-point maps: half the time of float maps.
    """
    source, scaled, network = plan.source, plan.scaled, plan.network
    lens = lens or Lens(tuple(source.matrix.reshape(-1).tolist()))
    # Pixel areas shrink, so pixel centres move: u + 1/2 is divided, not u.
    move = 0.5 / factor - 0.5
    shrink = np.array([[1 / factor, 0.0, move], [0.0, 1 / factor, move], [0.0, 0.0, 1.0]])
    make = cv2.fisheye.initUndistortRectifyMap if lens.model == "equidistant" else cv2.initUndistortRectifyMap
    places = make(
        shrink @ np.reshape(lens.matrix, (3, 3)),
        np.array(lens.distortion or (0.0,) * 5),
        np.reshape(lens.rotation, (3, 3)),
        scaled.matrix,
        (scaled.width, scaled.height),
        cv2.CV_32FC1,
    )
    rows, columns = network.height - scaled.height, network.width - scaled.width

    def padded(place: npt.NDArray[np.float32], size: int) -> npt.NDArray[np.float32]:
        # What lies in the outer half of a pixel at the border has that pixel's colour, not a mixture with black.
        is_inside = (place > -0.5 - _ROUNDING_PX) & (place < size / factor - 0.5 + _ROUNDING_PX)
        clipped = np.where(is_inside, np.clip(place, 0, size // factor - 1), place)
        bordered: npt.NDArray[np.float32] = cv2.copyMakeBorder(clipped, 0, rows, 0, columns, cv2.BORDER_REPLICATE)
        return bordered

    u, v = padded(places[0], source.width), padded(places[1], source.height)
    coordinates, fractions = cv2.convertMaps(u, v, cv2.CV_16SC2)
    return coordinates, fractions


def enlarge_smooth(values: FloatArray, plan: CanonicalCamera, camera: CameraModel) -> FloatArray:
    """Brings a map of the network's to the size of a camera, bilinear.

    Args:
        values: (h, w) float32 at the size of `plan.network`, or smaller by a whole factor; finite.
        plan: The plan.
        camera: `plan.source`, `plan.scaled`, or the same view at another size.

    Returns:
        (H, W) float32 at the camera's size, in memory that a message can take over, see `_outgoing`.
    """
    network = plan.network
    if values.shape != (network.height, network.width):
        values = cv2.resize(values, (network.width, network.height), interpolation=cv2.INTER_LINEAR)
    result: FloatArray = _outgoing(camera, np.dtype(np.float32))
    seen = values[: plan.scaled.height, : plan.scaled.width]
    cv2.resize(seen, (camera.width, camera.height), dst=result, interpolation=cv2.INTER_LINEAR)
    return result


def enlarge_nearest(values: npt.NDArray[ValueT], plan: CanonicalCamera, camera: CameraModel) -> npt.NDArray[ValueT]:
    """Brings a map of the network's to the size of a camera; each pixel takes the nearest value, NaN stays as it is.

    Args:
        values: As in `enlarge_smooth`, but may hold NaN, or be numbers of classes, uint8.
        plan: The plan.
        camera: As in `enlarge_smooth`.

    Returns:
        As in `enlarge_smooth`, of the type of `values`.
    """
    height, width = values.shape
    row_scale = plan.scaled.height / plan.network.height * height / camera.height
    column_scale = plan.scaled.width / plan.network.width * width / camera.width
    rows = ((np.arange(camera.height) + 0.5) * row_scale).astype(np.intp)
    columns = ((np.arange(camera.width) + 0.5) * column_scale).astype(np.intp)
    # The small map becomes wide before it becomes high: whole rows are copied then. "clip" spares numpy a second copy.
    result: npt.NDArray[ValueT] = _outgoing(camera, values.dtype)
    values.take(columns, axis=1).take(rows, axis=0, out=result, mode="clip")
    return result


def spread_nearest(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gives every pixel the value of the pixel with a value that is nearest in the image.

    OpenCV's distance transform with a 5 x 5 mask: distances are right to about 2 %, so a pixel nearly halfway between
    two values may get the other one. An exact search takes 50 times as long.

    Args:
        values: (H, W) float32, NaN where there is none.

    Returns:
        The values (H, W) float32, all NaN when there was none, and the distance to where they come from, (H, W) float32
        pixels.
    """
    has_value = np.isfinite(values)
    if not has_value.any():
        return np.full_like(values, np.nan), np.full_like(values, np.inf)
    distance, label = cv2.distanceTransformWithLabels(
        np.where(has_value, np.uint8(0), np.uint8(1)), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(label.max()) + 1, np.float32)
    of_label[label[has_value]] = values[has_value]
    return of_label[label], distance


def _outgoing(camera: CameraModel, dtype: np.dtype[ValueT]) -> npt.NDArray[ValueT]:
    """Memory for an image, (H, W), as an array.array: rclpy's messages take such a one without copying."""
    memory = array.array("B", b"\0") * (dtype.itemsize * camera.height * camera.width)
    return np.frombuffer(memory, dtype).reshape(camera.height, camera.width)
