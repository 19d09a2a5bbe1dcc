"""Rigid transforms, the transform tree, projection, the flat road and the canonical camera.

A transform is named `target_from_source`: it takes points given in the source frame to the target frame. Pixel centres
are at whole numbers: u = fx x / z + cx (the convention of sensor_msgs/CameraInfo and OpenCV).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, GroundPlane, RadcamDepthError

DoubleArray = npt.NDArray[np.float64]

NETWORK_MULTIPLE = 32
"""Height and width of what a network is given are multiples of this: five halvings."""

MAX_LINKS = 1000
"""A transform tree takes no more: memory stays bounded whatever comes on /tf."""

_NO_ROTATION = np.eye(3)
_LARGEST_DEVIATION = 1e-5
"""Of a rotation times its transpose."""


class GeometryError(RadcamDepthError):
    """A transform that is missing, impossible or not rigid; an image size that no network can be given."""


@dataclass(frozen=True)
class RigidTransform:
    """A rotation and a translation.

    Attributes:
        rotation: (3, 3) float64, orthonormal, determinant 1.
        translation: (3,) float64, metres.
    """

    rotation: DoubleArray
    translation: DoubleArray

    def __post_init__(self) -> None:
        if self.rotation.shape != (3, 3) or self.translation.shape != (3,):
            raise GeometryError(
                f"a rigid transform needs a (3, 3) rotation and a (3,) translation, got {self.rotation.shape} "
                f"and {self.translation.shape}"
            )
        # Not np.allclose, which takes ten times as long; a message of /tf may have a thousand of them. NaN is larger.
        deviation = np.abs(self.rotation @ self.rotation.T - _NO_ROTATION)
        if not np.isfinite(self.translation).all() or not deviation.max() <= _LARGEST_DEVIATION:
            raise GeometryError("a rigid transform needs a finite translation and an orthonormal rotation")

    @classmethod
    def identity(cls) -> RigidTransform:
        """The transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_quaternion(cls, translation_m: npt.ArrayLike, quaternion_xyzw: npt.ArrayLike) -> RigidTransform:
        """From ROS's order of values.

        Args:
            translation_m: x, y, z in metres.
            quaternion_xyzw: x, y, z, w; scaled to length 1, so it must be longer than 0.

        Raises:
            GeometryError: for a quaternion of length 0 or values that are not finite.
        """
        quaternion: list[float] = np.asarray(quaternion_xyzw, np.float64).tolist()
        length = math.hypot(*quaternion) if len(quaternion) == 4 else 0.0
        if not math.isfinite(length) or length < 1e-6:
            raise GeometryError(
                f"a rotation needs a quaternion x y z w of length 1, got {quaternion}; no rotation is 0 0 0 1"
            )
        x, y, z, w = (value / length for value in quaternion)
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(rotation, np.asarray(translation_m, np.float64))

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The rotation as x, y, z, w with w >= 0."""
        # The largest eigenvector of this symmetric matrix is the quaternion (Bar-Itzhack 2000): no case distinction.
        m = self.rotation
        k = np.array(
            [
                [m[0, 0] - m[1, 1] - m[2, 2], 0.0, 0.0, 0.0],
                [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0.0, 0.0],
                [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0.0],
                [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
            ]
        )
        x, y, z, w = np.linalg.eigh(k)[1][:, -1]
        sign = -1.0 if w < 0 else 1.0
        return float(sign * x), float(sign * y), float(sign * z), float(sign * w)

    def inverse(self) -> RigidTransform:
        """`source_from_target`."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        return RigidTransform(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points_m: npt.NDArray[np.floating]) -> FloatArray:
        """Takes (N, 3) points from the source to the target frame; (N, 3) float32."""
        return np.asarray(points_m @ self.rotation.T + self.translation, np.float32)


class TransformTree:
    """Frames and how they are fixed to one another, filled from `/tf_static`, `/tf` or parameters.

    Frame names lose a leading slash, as in tf2. Each frame has one parent; setting it again replaces it.
    """

    def __init__(self) -> None:
        self._parent: dict[str, tuple[str, RigidTransform]] = {}
        # Asked for again with each sweep and image, while a vehicle's frames seldom change.
        self._found: dict[tuple[str, str], RigidTransform] = {}

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames that are known, sorted."""
        return tuple(sorted({*self._parent, *(parent for parent, _ in self._parent.values())}))

    def copy(self) -> TransformTree:
        """Another tree with the frames as they are now."""
        tree = TransformTree()
        tree._parent.update(self._parent)
        return tree

    def parent_of(self, frame: str) -> str | None:
        """The frame that a frame is fixed to; None for the root of a tree and for a frame that is not known."""
        link = self._parent.get(frame.lstrip("/"))
        return link[0] if link is not None else None

    def set(self, parent_frame: str, child_frame: str, parent_from_child: RigidTransform) -> None:
        """Fixes a frame to its parent.

        Raises:
            GeometryError: for an empty name, a frame that is its own parent, one that would close a cycle, or one
                more than `MAX_LINKS`.
        """
        parent, child = parent_frame.lstrip("/"), child_frame.lstrip("/")
        if not parent or not child:
            raise GeometryError(
                f"a transform needs two frame names, got parent {parent_frame!r} and child {child_frame!r}"
            )
        if child not in self._parent and len(self._parent) >= MAX_LINKS:
            raise GeometryError(
                f"there are {MAX_LINKS} frames already, so {child!r} is left out; mend who publishes ever new names on "
                "/tf, and activate the node again"
            )
        ancestor: str | None = parent
        while ancestor is not None:
            if ancestor == child:
                raise GeometryError(
                    f"the transform {parent!r} -> {child!r} closes a cycle: {parent!r} is already below {child!r}; "
                    "remove one of the two publishers"
                )
            ancestor = self._parent[ancestor][0] if ancestor in self._parent else None
        self._parent[child] = (parent, parent_from_child)
        self._found.clear()

    def has_room_for(self, child_frame: str) -> bool:
        """Whether `set` takes this frame: it is known, or there are fewer than `MAX_LINKS`."""
        return child_frame.lstrip("/") in self._parent or len(self._parent) < MAX_LINKS

    def remove(self, frame: str) -> None:
        """Forgets a frame's link to its parent; does nothing for a frame that has none."""
        if self._parent.pop(frame.lstrip("/"), None) is not None:
            self._found.clear()

    def joining(self, frames: Iterable[str]) -> frozenset[str]:
        """The frames whose links join these: each of them and what is above it, up to below what carries them all.

        Where nothing carries them all, and of a single frame, up to the root. Frames that are not known do not count.
        """
        known = frozenset(self.frames)
        paths = [self._path(frame) for frame in {frame.lstrip("/") for frame in frames} if frame in known]
        shared = frozenset.intersection(*map(frozenset, paths)) if len(paths) > 1 else frozenset()
        return frozenset(frame for path in paths for frame in path if frame not in shared)

    def link(self, frame: str) -> tuple[str, RigidTransform] | None:
        """A frame's parent and `parent_from_frame`; None where it has none, or is not known."""
        return self._parent.get(frame.lstrip("/"))

    def can_transform(self, target_frame: str, source_frame: str) -> bool:
        """Whether `lookup` would succeed."""
        target, source = target_frame.lstrip("/"), source_frame.lstrip("/")
        if (target, source) in self._found:
            return True
        return self._root(target) == self._root(source)

    def lookup(self, target_frame: str, source_frame: str) -> RigidTransform:
        """`target_from_source`, through any chain of parents and children.

        Raises:
            GeometryError: when a frame is not known, or the two are in trees that are not joined.
        """
        target, source = target_frame.lstrip("/"), source_frame.lstrip("/")
        if target == source:
            return RigidTransform.identity()
        if (target, source) in self._found:
            return self._found[target, source]
        frames = self.frames
        for frame in (target, source):
            if frame not in frames:
                near = difflib.get_close_matches(frame, frames, n=1)
                known = ", ".join(frames) if frames else "none: nothing came on /tf_static"
                hint = f" (did you mean {near[0]!r}?)" if near else ""
                raise GeometryError(
                    f"no transform from {source!r} to {target!r}: frame {frame!r} is not known{hint}; "
                    f"known frames: {known}"
                )
        target_root, root_from_target = self._chain(target)
        source_root, root_from_source = self._chain(source)
        if target_root != source_root:
            raise GeometryError(
                f"no transform from {source!r} to {target!r}: they are in two trees, below {source_root!r} and "
                f"{target_root!r}; publish the link between these on /tf_static"
            )
        found = self._found[target, source] = root_from_target.inverse() @ root_from_source
        return found

    def _path(self, frame: str) -> list[str]:
        path = [frame]
        while path[-1] in self._parent:
            path.append(self._parent[path[-1]][0])
        return path

    def _root(self, frame: str) -> str:
        while frame in self._parent:
            frame = self._parent[frame][0]
        return frame

    def _chain(self, frame: str) -> tuple[str, RigidTransform]:
        root, root_from_frame = frame, RigidTransform.identity()
        while root in self._parent:
            root, parent_from_child = self._parent[root]
            root_from_frame = parent_from_child @ root_from_frame
        return root, root_from_frame


def project(points_m: npt.NDArray[np.floating], camera: CameraModel) -> tuple[FloatArray, FloatArray]:
    """Projects points in camera axes.

    Args:
        points_m: (N, 3) metres.
        camera: The camera.

    Returns:
        uv (N, 2) float32 pixels, not clipped to the image, NaN where depth is not positive; depth (N,) float32 metres.
    """
    depth = points_m[:, 2].astype(np.float32)
    safe = np.where(depth > 0, depth, np.float32("nan"))
    with np.errstate(over="ignore"):  # just before the camera: infinitely far outside of the image
        u = points_m[:, 0] / safe * camera.fx + camera.cx
        v = points_m[:, 1] / safe * camera.fy + camera.cy
        return np.stack([u, v], axis=1).astype(np.float32), depth


def unproject(depth_m: FloatArray, camera: CameraModel) -> FloatArray:
    """The point of each pixel.

    Args:
        depth_m: (H, W) float32 depth along z in metres, at the camera's size.
        camera: The camera.

    Returns:
        (H, W, 3) float32 metres in the camera's frame.
    """
    x = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy)) / np.float32(camera.fy)
    return np.stack([depth_m * x[None, :], depth_m * y[:, None], depth_m], axis=-1)


def depth_image(points_m: npt.NDArray[np.floating], camera: CameraModel) -> FloatArray:
    """Draws points (N, 3) in camera axes as a depth image (H, W) float32: NaN where there is none, the nearest wins."""
    uv, depth = project(points_m, camera)
    visible = depth > 0
    column = np.round(np.where(visible, uv[:, 0], -1)).astype(np.int64)
    row = np.round(np.where(visible, uv[:, 1], -1)).astype(np.int64)
    visible &= (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    flat = np.full(camera.height * camera.width, np.inf, np.float32)
    np.minimum.at(flat, row[visible] * camera.width + column[visible], depth[visible])
    flat[np.isinf(flat)] = np.nan
    return flat.reshape(camera.height, camera.width)


def ground_plane(camera_from_footprint: RigidTransform) -> GroundPlane:
    """The flat road from the camera's place on the vehicle; the footprint frame lies on the road, z up (REP 105)."""
    up = camera_from_footprint.rotation[:, 2]
    height_m = float(camera_from_footprint.inverse().translation[2])
    return GroundPlane(height_m, (float(up[0]), float(up[1]), float(up[2])))


def ground_coefficients(ground: GroundPlane, camera: CameraModel) -> FloatArray:
    """The flat road's inverse depth as a linear function of the pixel.

    A point X = z K^-1 (u, v, 1) lies on the road when up . X = -height, so 1 / z = a u + b v + c.

    Returns:
        (4,) float32: a, b, c in 1 / m, NaN where the height is unknown; the sum is not positive above the horizon.
        And whether the height is known, 1, or assumed or unknown, 0.
    """
    if not ground.is_known:
        return np.array([np.nan, np.nan, np.nan, 0.0], np.float32)
    up_x, up_y, up_z = ground.up
    a = -up_x / (camera.fx * ground.height_m)
    b = -up_y / (camera.fy * ground.height_m)
    c = -up_z / ground.height_m - a * camera.cx - b * camera.cy
    return np.array([a, b, c, float(not ground.is_assumed)], np.float32)


@dataclass(frozen=True)
class CanonicalCamera:
    """How an image is brought to the focal length that a network was trained at.

    The image is scaled so that both focal lengths become the network's, and padded at the right and at the bottom to
    multiples of 32. So one network serves any lens: a wall keeps its size in pixels, and its depth.

    Attributes:
        source: The camera as it is.
        scaled: The same camera after scaling, without padding.
        network: The same camera with the padded size: what the network sees.
    """

    source: CameraModel
    scaled: CameraModel
    network: CameraModel

    @classmethod
    def plan(cls, source: CameraModel, focal_length_px: float, max_pixels: int = 4_000_000) -> CanonicalCamera:
        """Plans the resampling of a camera.

        Args:
            source: The rectified camera.
            focal_length_px: The network's focal length, pixels.
            max_pixels: Refuse to give the network more than this: a wide lens with many pixels would need it.

        Raises:
            GeometryError: when the image would have more than `max_pixels`.
        """
        width = max(1, round(source.width * focal_length_px / source.fx))
        height = max(1, round(source.height * focal_length_px / source.fy))
        padded_width = -(-width // NETWORK_MULTIPLE) * NETWORK_MULTIPLE
        padded_height = -(-height // NETWORK_MULTIPLE) * NETWORK_MULTIPLE
        if padded_width * padded_height > max_pixels:
            raise GeometryError(
                f"a {source.width} x {source.height} image with focal lengths {source.fx:.0f} and {source.fy:.0f} px "
                f"becomes {width} x {height} at the network's focal length of {focal_length_px:.0f} px, more than "
                f"{max_pixels} pixels; check camera_info or crop the image (CameraInfo's ROI)"
            )
        scaled = source.resized(width, height)
        network = CameraModel(padded_width, padded_height, scaled.fx, scaled.fy, scaled.cx, scaled.cy)
        return cls(source, scaled, network)
