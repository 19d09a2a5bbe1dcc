"""Camera height, pitch and roll above the road from the road's texture in two images and the distance between them.

The road is a plane, bent a little along the way. Tracks of the whole scene give the rotation and the direction of the
travel (epipolar geometry); the road's texture gives the plane (plane-induced homography, Hartley and Zisserman 2004,
section 13.1). The scale comes from the distance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.calibration.road_plane import PlaneEstimate
from radcam_depth_ros.frame import CameraModel
from radcam_depth_ros.geometry import DoubleArray

TRACKS = 800
"""Points that are tracked over the whole image."""
_LEAST_TRACKS = 40
_LEAST_CORRELATION = 0.1
_LEAST_PIXELS = 1500
"""Fewer pixels of textured road give no plane."""
_LEAST_SPREAD = 1.0
"""Grey values squared; less is no texture."""
_ASIDE_M, _FAR_M, _FAR_HEIGHTS = 3.0, 6.0, 5.0
"""The road is looked at so far to both sides, and so far ahead with so many of the camera's heights more."""
_ASIDE_SEARCH, _FAR_SEARCH = 1.5, 8.0
"""Where the height is yet to be found, both in multiples of it: the same pixels for any height."""
_FARTHEST_M = 40.0
_PATCH_PX = 25
_MOST_PIXELS = 12_000
_SHARED_PIXELS = 10.0
"""So many pixels next to one another have one error in common."""
_BACK_PX, _TRACK_PX = 0.5, 0.4
"""A track that comes back farther than that from its start is none; standard deviation of a track's place."""
_ALONG_ROAD = 0.006
"""The camera travels along the road to so many radians (standard deviation)."""
_BEND = 0.003
"""Change of slope a metre (standard deviation)."""
_ROLL = 0.06
"""Radians (standard deviation)."""
_LEAST_AHEAD = 0.4
_SCALES = ((2, 8), (1, 8))
"""The image is made so many times smaller for so many steps."""
_STEP = 1e-5


class TextureError(Exception):
    """A pair of images that does not give the road; the message says why."""


@dataclass(frozen=True)
class _Tracks:
    """Points (N, 3) in two images as rays with z = 1."""

    first: DoubleArray
    second: DoubleArray


@dataclass(frozen=True)
class _State:
    """What is estimated.

    Attributes:
        vector: (9,) rotation vector of the second camera, azimuth and elevation (down) of the travel, logarithm of the
            height, pitch, roll, bend of the road (1 / m).
    """

    vector: DoubleArray

    @property
    def height_m(self) -> float:
        return float(np.exp(np.clip(self.vector[5], -3.0, 3.0)))

    @property
    def up(self) -> DoubleArray:
        """The road's normal, as `level_ground` has it."""
        pitch, roll = self.vector[6:8]
        return np.array([-np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), -np.sin(pitch)])

    @property
    def travel(self) -> DoubleArray:
        """Unit vector."""
        azimuth, down = self.vector[3:5]
        return np.array([np.cos(down) * np.sin(azimuth), np.sin(down), np.cos(down) * np.cos(azimuth)])

    @property
    def matrix(self) -> DoubleArray:
        return np.asarray(cv2.Rodrigues(np.asarray(self.vector[:3]))[0])

    def depth_m(self, rays: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Depth (...) of the road along rays (..., 3); not positive above the horizon."""
        fall = -(rays @ self.up.astype(rays.dtype))
        fall[np.abs(fall) < 1e-6] = 1e-6
        depth_m = self.height_m / fall
        for _ in range(2):
            ahead_m = np.clip(depth_m, 0.0, _FARTHEST_M)
            depth_m = (self.height_m - self.vector[8] / 2 * ahead_m**2) / fall
        return np.asarray(depth_m)

    def second(self, rays: npt.NDArray[Any], distance_m: float) -> npt.NDArray[Any]:
        """Rays (..., 3), z = 1, at which the second camera sees the road's points."""
        shift, matrix = (distance_m * self.travel).astype(rays.dtype), self.matrix.T.astype(rays.dtype)
        points = (self.depth_m(rays)[..., None] * rays - shift) @ matrix
        return np.asarray(points / np.maximum(points[..., 2:], 1e-3))

    def priors(self) -> DoubleArray:
        """What is likely of any road, in standard deviations."""
        along = float(self.up @ self.travel)
        return np.array([along / _ALONG_ROAD, self.vector[7] / _ROLL, self.vector[8] / _BEND])


class TexturePair:
    """Two images of a drive, one after the other.

    Args:
        first: (H, W) grey, rectified.
        second: The later image, of the same camera.
        camera: Both images' camera.
        distance_m: How far the camera travelled in between.

    Raises:
        TextureError: where the images do not tell how the camera moved.
    """

    def __init__(
        self, first: npt.NDArray[np.uint8], second: npt.NDArray[np.uint8], camera: CameraModel, distance_m: float
    ) -> None:
        self._tracks, self._start = _start(_scene_tracks(first, second, camera), camera)
        self._images = (first, second, camera, distance_m)

    def scores(self, heights_m: DoubleArray) -> DoubleArray:
        """How well (N,) the images fit at some heights (N,) of the camera: correlations of the road's patches."""
        level = _Level(*self._images, _SCALES[0][0])
        found = []
        for height_m in heights_m.tolist():
            extent = (_ASIDE_SEARCH * height_m, _FAR_SEARCH * height_m)
            found.append(level.compare(self._at(height_m), extent).score)
        return np.array(found)

    def fit(self, height_m: float) -> PlaneEstimate:
        """The road that explains both images.

        Args:
            height_m: The camera's height to within a tenth.

        Raises:
            TextureError: where the images do not tell.
        """
        state = self._at(height_m)
        for factor, steps in _SCALES:
            level = _Level(*self._images, factor)
            for _ in range(steps):
                state, covariance, correlation = _step(level, self._tracks, state)
        if correlation < _LEAST_CORRELATION:
            raise TextureError("the road's texture does not move as a plane")
        deviations = np.sqrt(np.diag(covariance))[5:8] * [state.height_m, 180 / np.pi, 180 / np.pi]
        pitch_deg, roll_deg = np.rad2deg(state.vector[6:8]).tolist()
        height_deviation_m, *turn_deviations_deg = deviations.tolist()
        return PlaneEstimate(state.height_m, pitch_deg, roll_deg, (height_deviation_m, *turn_deviations_deg))

    def _at(self, height_m: float) -> _State:
        vector = self._start.vector.copy()
        vector[5] = np.log(height_m)
        return _State(vector)


def _rays(uv: npt.NDArray[np.floating], camera: CameraModel) -> DoubleArray:
    scaled = (np.asarray(uv, np.float64) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.concatenate([scaled, np.ones((*scaled.shape[:-1], 1))], axis=-1)


def _scene_tracks(first: Any, second: Any, camera: CameraModel) -> _Tracks:
    equalised = cv2.createCLAHE(3.0, (8, 8))
    one, two = equalised.apply(first), equalised.apply(second)
    points: Any = cv2.goodFeaturesToTrack(one, TRACKS, 0.005, 8)
    if points is None or len(points) < _LEAST_TRACKS:
        raise TextureError("too little texture")
    there, found, _ = cv2.calcOpticalFlowPyrLK(one, two, points, points.copy(), winSize=(21, 21), maxLevel=4)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(two, one, there, there.copy(), winSize=(21, 21), maxLevel=4)
    good = (found[:, 0] == 1) & (found_back[:, 0] == 1) & (np.abs(back - points).max(axis=(1, 2)) < _BACK_PX)
    if good.sum() < _LEAST_TRACKS:
        raise TextureError("too little can be followed from image to image")
    return _Tracks(_rays(points[good, 0], camera), _rays(there[good, 0], camera))


def _start(tracks: _Tracks, camera: CameraModel) -> tuple[_Tracks, _State]:
    """Rotation and direction of the travel by the tracks, and the tracks that agree."""
    first, second = tracks.first[:, :2], tracks.second[:, :2]
    essential, mask = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.999, 1.0 / camera.fx)
    if essential is None or essential.shape != (3, 3):
        raise TextureError("the tracks fit no motion")
    _, rotation, shift, _ = cv2.recoverPose(essential, first, second, np.eye(3), mask=mask)
    travel = -(rotation.T @ shift)[:, 0]
    vector = np.zeros(9)
    vector[:5] = (*cv2.Rodrigues(rotation)[0][:, 0], np.arctan2(travel[0], travel[2]), np.arcsin(travel[1]))
    for _ in range(8):
        now, jacobian = _epipolar_terms(_State(vector), tracks, camera)
        _, change = _solved(now, jacobian[:, :5], 1 / (1 + (now / 2) ** 2))
        vector[:5] += change
    state = _State(vector)
    if abs(state.travel[2]) < _LEAST_AHEAD:
        raise TextureError("the camera does not travel along its view")
    # The camera travels along the road: so far that is the pitch.
    vector[6] = -np.arctan(state.travel[1] / state.travel[2])
    agrees = np.abs(_epipolar(state, tracks) * camera.fx / _TRACK_PX) < 4.0
    if agrees.sum() < _LEAST_TRACKS:
        raise TextureError("too few tracks fit one motion")
    return _Tracks(tracks.first[agrees], tracks.second[agrees]), state


def _epipolar(state: _State, tracks: _Tracks) -> DoubleArray:
    """(N,) Sampson distances of the tracks at focal length 1 (Hartley and Zisserman 2004, section 11.4.3)."""
    x, y, z = state.travel
    essential = state.matrix @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    one, two = tracks.first @ essential.T, tracks.second @ essential
    error = (tracks.second * one).sum(axis=1)
    return np.asarray(error / np.sqrt((one[:, :2] ** 2).sum(axis=1) + (two[:, :2] ** 2).sum(axis=1) + 1e-12))


def _epipolar_terms(state: _State, tracks: _Tracks, camera: CameraModel) -> tuple[DoubleArray, DoubleArray]:
    """Residuals (N,) of tracks in standard deviations and their derivatives (N, 9)."""
    return _derived(lambda other: _epipolar(other, tracks) * camera.fx / _TRACK_PX, state)


def _derived(function: Callable[[_State], npt.NDArray[Any]], state: _State) -> tuple[DoubleArray, DoubleArray]:
    """A function's values (...) and derivatives (..., 9)."""
    now = function(state)
    steps = _STEP * np.eye(len(state.vector))
    return now, np.stack([(function(_State(state.vector + step)) - now) / _STEP for step in steps], axis=-1)


def _solved(now: DoubleArray, jacobian: DoubleArray, weights: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """The information matrix of a step of Gauss and Newton, and the step."""
    information = jacobian.T @ (weights[:, None] * jacobian)
    change = -np.linalg.solve(information + 1e-9 * np.eye(len(information)), jacobian.T @ (weights * now))
    if not np.isfinite(change).all():
        raise TextureError("the fit has no solution")
    return information, np.clip(change, -0.1, 0.1)


class _Level:
    """Both images at a scale."""

    def __init__(self, first: Any, second: Any, camera: CameraModel, distance_m: float, factor: int) -> None:
        width, height = camera.width // factor, camera.height // factor
        move = 0.5 / factor - 0.5
        self.camera = CameraModel(
            width, height, camera.fx / factor, camera.fy / factor, camera.cx / factor + move, camera.cy / factor + move
        )
        self.distance_m = distance_m
        whole, size = (slice(0, height * factor), slice(0, width * factor)), (width, height)
        small = (cv2.resize(image[whole], size, interpolation=cv2.INTER_AREA) for image in (first, second))
        one, two = (cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32) for image in small)
        self._first, self._second = one, two
        # What stays at its place in the image is a car ahead, the own bonnet or dirt on the lens.
        patch = _PATCH_PX // factor | 1
        alike = cv2.blur(_normal(one, patch)[0] * _normal(two, patch)[0], (patch, patch))
        self._moves = np.clip(1 - alike, 0, 1) ** 2
        self._patch = patch
        self._slopes = tuple(cv2.Sobel(two, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
        columns, rows = np.meshgrid(np.arange(width), np.arange(height))
        self._grid = _rays(np.stack([columns, rows], axis=-1), self.camera).astype(np.float32)

    def pixels(self, state: _State, rays: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Where (..., 2) the second camera sees the road's points."""
        camera = self.camera
        rays = state.second(rays, self.distance_m)[..., :2]
        focal, centre = np.array([camera.fx, camera.fy], rays.dtype), np.array([camera.cx, camera.cy], rays.dtype)
        return np.asarray(rays * focal + centre)

    def compare(self, state: _State, extent: tuple[float, float]) -> _Comparison:
        """The first image against the second, moved as the road would.

        Args:
            state: The road and the motion.
            extent: The road as far to both sides and ahead is looked at, in metres.
        """
        depth_m = state.depth_m(self._grid)
        aside_m, ahead_m = extent
        region = (depth_m > 0) & (depth_m < ahead_m) & (np.abs(self._grid[..., 0] * depth_m) < aside_m)
        top = int(np.argmax(region.any(axis=1)))
        rows = slice(max(0, top - _PATCH_PX), None)
        grid, region = self._grid[rows], region[rows]
        wanted = int(region.sum())
        places = self.pixels(state, grid).astype(np.float32)
        size = np.array([self.camera.width - 1, self.camera.height - 1])
        region &= ((places >= 0) & (places < size)).all(axis=-1)
        warped = cv2.remap(self._second, places, None, cv2.INTER_LINEAR)
        one, one_spread = _normal(self._first[rows], self._patch)
        two, two_spread = _normal(warped, self._patch)
        agreement = cv2.blur(one * two, (self._patch, self._patch))
        region &= (one_spread > _LEAST_SPREAD) & (two_spread > _LEAST_SPREAD)
        slopes = [
            cv2.remap(slope, places, None, cv2.INTER_LINEAR) / np.sqrt(two_spread + 1.0) for slope in self._slopes
        ]
        # Another height moves the road along these: lines along them fit at any height.
        higher = state.vector + 0.01 * np.eye(len(state.vector))[5]
        along = self.pixels(_State(higher), grid) - places
        along /= np.linalg.norm(along, axis=-1, keepdims=True) + 1e-6
        patch = (self._patch, self._patch)
        told = cv2.blur((slopes[0] * along[..., 0] + slopes[1] * along[..., 1]) ** 2, patch)
        told /= cv2.blur(slopes[0] ** 2 + slopes[1] ** 2, patch) + 1e-3
        return _Comparison(
            grid,
            region,
            two - one,
            np.clip(agreement, 0, 1),
            told * self._moves[rows],
            self._moves[rows],
            slopes[0],
            slopes[1],
            wanted,
        )


@dataclass(frozen=True)
class _Comparison:
    """The images normalised, one minus the other.

    Attributes:
        rays: (H, W, 3) the pixels' rays in the first camera.
        region: (H, W) which of them are looked at.
        difference: (H, W) the second image minus the first.
        agreement: (H, W) their local correlation, 0 to 1.
        told: (H, W) share of the slopes that the camera's height moves.
        moves: (H, W) 0 where the images are the same, 1 where they are not.
        slope_x: (H, W) the second image's slope a pixel.
        slope_y: (H, W) likewise.
        wanted: How many pixels of the road are in the first image.
    """

    rays: npt.NDArray[np.float32]
    region: npt.NDArray[np.bool_]
    difference: Any
    agreement: Any
    told: Any
    moves: Any
    slope_x: Any
    slope_y: Any
    wanted: int

    @property
    def correlation(self) -> float:
        """The mean correlation of patches, of those most that tell the height."""
        told = self.told[self.region]
        return float((self.agreement[self.region] * told).sum() / (told.sum() + 1.0))

    @property
    def score(self) -> float:
        """The same, and less where less of the road is in the second image."""
        return self.correlation * math.sqrt(self.region.sum() / max(1, self.wanted))


def _normal(image: Any, patch: int) -> tuple[Any, Any]:
    """An image without its local mean and divided by its local spread, and that spread squared."""
    mean = cv2.blur(image, (patch, patch))
    spread = np.maximum(cv2.blur(image * image, (patch, patch)) - mean * mean, 0.0)
    return (image - mean) / np.sqrt(spread + 1.0), spread


def _step(level: _Level, tracks: _Tracks, state: _State) -> tuple[_State, DoubleArray, float]:
    """A step of Gauss and Newton with robust weights, its covariance (9, 9), and the correlation before it."""
    found = level.compare(state, (_ASIDE_M, _FAR_M + _FAR_HEIGHTS * state.height_m))
    index = np.flatnonzero(found.region)
    if len(index) < _LEAST_PIXELS // 4:
        raise TextureError("too little of the road is in view, or it is too dark or has no texture")
    thinned = max(1, len(index) // _MOST_PIXELS)
    index = index[::thinned]
    rays = found.rays.reshape(-1, 3)[index].astype(np.float64)
    _, moved = _derived(lambda other: level.pixels(other, rays), state)
    slopes = np.stack([found.slope_x.reshape(-1)[index], found.slope_y.reshape(-1)[index]], axis=-1)
    difference = found.difference.reshape(-1)[index].astype(np.float64)
    agreement = (found.agreement * found.moves).reshape(-1)[index].astype(np.float64)
    spread = 1.48 * float(np.median(np.abs(difference))) + 0.05
    weights = agreement**2 / (1 + (difference / (2 * spread)) ** 2) / spread**2 * min(1.0, thinned / _SHARED_PIXELS)
    scene, scene_slopes = _epipolar_terms(state, tracks, level.camera)
    prior, prior_slopes = _derived(lambda other: other.priors(), state)
    values = np.concatenate([difference, scene, prior])
    jacobian = np.concatenate([np.einsum("nd,ndp->np", slopes, moved), scene_slopes, prior_slopes])
    information, change = _solved(
        values, jacobian, np.concatenate([weights, 1 / (1 + (scene / 2) ** 2), np.ones(len(prior))])
    )
    return _State(state.vector + change), np.asarray(np.linalg.pinv(information)), found.correlation
