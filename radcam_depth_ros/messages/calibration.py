"""Decodes CameraInfo: the ideal camera, and the distortion of the published image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FrameError, ImageArray, Lens
from radcam_depth_ros.messages.wire import MessageError, check_image_size, require_fields

DoubleArray = npt.NDArray[np.float64]

# Numbers of coefficients that each model may have, as OpenCV takes them: the order is k1 k2 p1 p2 k3, then k4 k5 k6,
# thin prism and tilt.
_COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (5, 8, 12, 14), "equidistant": (4,)}
_SYNONYMS = {"fisheye": "equidistant", "kannala_brandt4": "equidistant", "radtan": "plumb_bob"}
_CLOSE_PX = 1e-3
_LARGEST = 1e9
_SHORTEST_FOCAL_LENGTH_PX = 1e-3


@dataclass(frozen=True)
class _Published:
    """What a CameraInfo says, for the image as it is published: region of interest and binning applied."""

    width: int
    height: int
    model: str
    distortion: DoubleArray
    raw: DoubleArray  # K, (3, 3)
    rotation: DoubleArray  # R, (3, 3)
    rectified: DoubleArray  # the first three columns of P, or K, (3, 3)


class Calibration:
    """What a CameraInfo says of a camera: its ideal model, with the intrinsics of P, and its lens.

    Distortion models are plumb_bob, rational_polynomial and equidistant (fisheye). K, R and P belong to the full
    resolution; a region of interest and binning are applied as image_geometry does: subtract the offset, then divide
    by the binning. Zeros in P mean K, zeros in R mean no rotation.

    Args:
        camera_info: A sensor_msgs/CameraInfo.
        image_is_rectified: Images are rectified already, as those of image_proc's `image_rect` are, whose CameraInfo
            still has the distortion of the raw image.

    Attributes:
        camera: The ideal camera of the rectified image.
        lens: How the published image differs from that camera's; None where it does not.

    Raises:
        MessageError: for K of zeros, values that are not finite, R that is no rotation, or an unknown distortion model.
    """

    def __init__(self, camera_info: Any, *, image_is_rectified: bool = False) -> None:
        self._key = _key(camera_info)
        published = _read(camera_info)
        matrix = published.rectified
        try:
            self.camera = CameraModel(
                published.width,
                published.height,
                float(matrix[0, 0]),
                float(matrix[1, 1]),
                float(matrix[0, 2]),
                float(matrix[1, 2]),
            )
        except FrameError as error:
            raise MessageError(f"the camera_info can't be used: {error}") from error
        self.lens = None if image_is_rectified or _is_ideal(published) else _lens(published)

    def matches(self, camera_info: Any) -> bool:
        """Whether a CameraInfo says the same as the one that this was made from; stamps don't matter."""
        return self._key == _key(camera_info)

    def check_size(self, image: ImageArray) -> None:
        """Refuses an image, (H, W) or (H, W, C), that is not of the camera's size.

        Raises:
            MessageError: when it is not.
        """
        expected = (self.camera.height, self.camera.width)
        if image.shape[:2] != expected:
            raise MessageError(
                f"expected an image of {self.camera.width} x {self.camera.height} pixels as its camera_info says, got "
                f"{image.shape[1]} x {image.shape[0]}; publish the camera_info of the resized image, or set its "
                "binning and region of interest"
            )


def _key(info: Any) -> tuple[object, ...]:
    names = ("width", "height", "distortion_model", "d", "k", "r", "p", "binning_x", "binning_y", "roi")
    require_fields(info, "sensor_msgs/CameraInfo", *names)
    matrices = tuple(np.asarray(values, np.float64).tobytes() for values in (info.d, info.k, info.r, info.p))
    roi = info.roi
    region = (roi.x_offset, roi.y_offset, roi.width, roi.height)
    return (info.width, info.height, info.distortion_model, info.binning_x, info.binning_y, *region, *matrices)


def _read(info: Any) -> _Published:
    k, r, p = _values(info, "k", 9), _values(info, "r", 9), _values(info, "p", 12)
    distortion = np.asarray(info.d, np.float64).reshape(-1)
    if not (np.abs(distortion) < _LARGEST).all():  # NaN is not
        raise MessageError(f"expected finite distortion in camera_info, got d={distortion.tolist()}; calibrate again")
    raw = k.reshape(3, 3)
    if min(raw[0, 0], raw[1, 1]) < _SHORTEST_FOCAL_LENGTH_PX:
        raise MessageError(
            f"expected a calibrated camera with positive focal lengths in camera_info, got k={k.tolist()}; "
            "calibrate the camera, or give the driver its calibration file"
        )
    rectified = p.reshape(3, 4)[:, :3] if p.any() else raw
    for name, matrix in (("k", raw), ("p", rectified)):
        # What is below the diagonal would be a rotation; with it, K may not be invertible.
        is_triangular = matrix[1, 0] == 0 and matrix[2].tolist() == [0.0, 0.0, 1.0]
        if min(matrix[0, 0], matrix[1, 1]) < _SHORTEST_FOCAL_LENGTH_PX or not is_triangular:
            raise MessageError(
                f"expected positive focal lengths, 0 below them and a last row of 0 0 1 in camera_info's {name}, got "
                f"{matrix.tolist()}; calibrate the camera"
            )
    model, distortion = _model(str(info.distortion_model), distortion)
    width, height, adjust = _published_region(info)
    check_image_size(width, height)
    rotation = _rotation(r.reshape(3, 3))
    if rotation[2, 2] <= 0:
        raise MessageError(
            "expected a rectified camera that looks where the camera does, got a rotation of 90 degrees or more in "
            f"camera_info's r, {rotation.reshape(-1).tolist()}; calibrate again"
        )
    return _Published(width, height, model, distortion, adjust @ raw, rotation, adjust @ rectified)


def _values(info: Any, name: str, count: int) -> DoubleArray:
    values = np.asarray(getattr(info, name), np.float64).reshape(-1)
    if values.size != count or not (np.abs(values) < _LARGEST).all():  # NaN is not
        raise MessageError(
            f"expected {count} finite numbers below {_LARGEST:g} in camera_info's {name}, got {values.tolist()}; "
            "calibrate the camera"
        )
    return values


def _published_region(info: Any) -> tuple[int, int, DoubleArray]:
    """Width and height of the published image, and the matrix that takes full-resolution pixels to its pixels."""
    binning = max(int(info.binning_x), 1), max(int(info.binning_y), 1)
    width, height = int(info.roi.width) or int(info.width), int(info.roi.height) or int(info.height)
    offset = int(info.roi.x_offset), int(info.roi.y_offset)
    if width < binning[0] or height < binning[1]:
        raise MessageError(
            f"expected a positive image size in camera_info, got {width} x {height} with binning {binning[0]} x "
            f"{binning[1]}; fill width and height"
        )
    if offset[0] + width > int(info.width) or offset[1] + height > int(info.height):
        raise MessageError(
            f"expected camera_info's region of interest within {info.width} x {info.height} pixels, got {width} x "
            f"{height} at {offset[0]}, {offset[1]}; the region is in pixels of the full resolution"
        )
    adjust = np.array(
        [
            [1 / binning[0], 0.0, -offset[0] / binning[0]],
            [0.0, 1 / binning[1], -offset[1] / binning[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    return width // binning[0], height // binning[1], adjust


def _model(name: str, distortion: DoubleArray) -> tuple[str, DoubleArray]:
    """The distortion model's one name, empty when nothing is distorted, and its coefficients."""
    if not distortion.any():
        return "", distortion
    model = _SYNONYMS.get(name.strip().lower(), name.strip().lower())
    if model not in _COEFFICIENTS:
        raise MessageError(
            f"expected the distortion model {', '.join(_COEFFICIENTS)}, or no distortion, got {name!r} with "
            f"d={distortion.tolist()}; calibrate with one of these, or publish rectified images with d of zeros"
        )
    most = max(_COEFFICIENTS[model])
    if not distortion[most:].any():  # some drivers fill up with zeros
        distortion = distortion[:most]
    if distortion.size not in _COEFFICIENTS[model]:
        counts = " or ".join(str(count) for count in _COEFFICIENTS[model])
        raise MessageError(
            f"expected {counts} distortion coefficients for {model}, got {distortion.size}; fix the camera_info"
        )
    return model, distortion


def _rotation(r: DoubleArray) -> DoubleArray:
    if not r.any():
        return np.eye(3)
    if not np.allclose(r @ r.T, np.eye(3), atol=1e-3) or np.linalg.det(r) < 0:
        raise MessageError(f"expected a rotation in camera_info's r, got {r.reshape(-1).tolist()}; calibrate again")
    return r


def _is_ideal(published: _Published) -> bool:
    """Whether rectifying would move no pixel by more than a thousandth."""
    if published.model:
        return False
    # A homography is what remains; it is compared where it moves most: in the corners.
    right, bottom = published.width - 1.0, published.height - 1.0
    corners = np.array([[0.0, 0.0, 1.0], [right, 0.0, 1.0], [0.0, bottom, 1.0], [right, bottom, 1.0]]).T
    moved = published.rectified @ published.rotation @ np.linalg.inv(published.raw) @ corners
    return bool(np.abs(moved[:2] / moved[2] - corners[:2]).max() < _CLOSE_PX)


def _lens(published: _Published) -> Lens:
    numbers = (published.raw, published.rotation, published.distortion)
    matrix, rotation, distortion = (tuple(values.reshape(-1).tolist()) for values in numbers)
    return Lens(matrix, rotation, published.model, distortion if published.model else ())
