"""Renders one view of the camera: radiance, exact depth and classes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.light.lamps import Lamps, shining_lamps
from radcam_depth_ros.simulation.light.shading import Hit, Shader, locate
from radcam_depth_ros.simulation.materials.surfaces import Label
from radcam_depth_ros.simulation.objects.scene import Hits, Scene

_NEAR_M, _FAR_M = 3.0, 60.0
_NEAR_STEP, _FAR_STEP = 2, 4
_PIECE = 16384
# Sub-pixel places of the additional samples, in pixels from the centre: spread evenly (a Halton sequence).
_SUBPIXELS = (
    (-0.25, 0.17),
    (0.25, -0.17),
    (-0.37, -0.39),
    (0.12, 0.39),
    (-0.12, -0.28),
    (0.37, 0.05),
    (-0.44, 0.28),
    (0.06, -0.06),
)


@dataclass(frozen=True)
class View:
    """One picture before development.

    Attributes:
        radiance: (H, W, 3) float32, linear.
        depth_m: (H, W) float32, metres along z at the pixel's centre; +inf in the sky.
        label: (H, W) uint8, values of `Label` at the pixel's centre.
        velocity: (H, W, 3) float32, m/s in world axes, of what is at the pixel's centre.
    """

    radiance: FloatArray
    depth_m: FloatArray
    label: ImageArray
    velocity: FloatArray


def render(
    scene: Scene,
    camera: CameraModel,
    world_from_camera: RigidTransform,
    shader: Shader,
    edge_samples: int,
    rng: np.random.Generator,
    turn_a_row: npt.NDArray[np.floating] | None = None,
) -> View:
    """Renders a view; the camera's axes are x right, y down, z forward.

    Args:
        scene: What is there.
        camera: Intrinsics.
        world_from_camera: The camera's pose at the middle row.
        shader: Gives colours to what is met.
        edge_samples: More rays for each pixel at an edge.
        rng: For soft light.
        turn_a_row: (3,) radians about the world's axes by which the camera turns from row to row, of a rolling shutter.
    """
    height, width = camera.height, camera.width
    column, row = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    turn = None if turn_a_row is None else np.asarray(turn_a_row, np.float32)
    rays = _Rays.cast(scene, camera, world_from_camera, column.ravel(), row.ravel(), turn)
    face = rays.hits.face
    # Directions have z = 1 in camera axes, so the distance along them is the depth.
    depth = rays.hits.distance_m.reshape(height, width)
    met = np.flatnonzero(face >= 0)
    label = np.full(height * width, Label.SKY, np.uint8)
    label[met] = scene.faces.label[face[met]]
    velocity = np.zeros((height * width, 3), np.float32)
    moving = np.flatnonzero(face >= scene.static_count)
    velocity[moving] = scene.velocity[face[moving]]
    openness = _openness(scene, rays, depth, rng).ravel()
    lamps = shining_lamps(scene, shader.light, world_from_camera, shader.beams)
    radiance = _radiance(scene, rays, openness, shader, lamps, rng)
    if edge_samples > 0:
        edges = np.flatnonzero(_edges(scene, face.reshape(height, width), depth).ravel())
        x, y = column.ravel()[edges], row.ravel()[edges]
        total = radiance[edges]
        for dx, dy in _SUBPIXELS[:edge_samples]:
            more = _Rays.cast(scene, camera, world_from_camera, x + np.float32(dx), y + np.float32(dy), turn)
            total = total + _radiance(scene, more, openness[edges], shader, lamps, rng)
        radiance[edges] = total / (1 + min(edge_samples, len(_SUBPIXELS)))
    shape = (height, width, 3)
    return View(radiance.reshape(shape), depth, label.reshape(height, width), velocity.reshape(shape))


@dataclass(frozen=True)
class _Rays:
    """Rays through places of the image, and what they met.

    Attributes:
        origin: (3,) float32, world.
        directions: (N, 3) float32, 1 along the camera's z.
        hits: What they met.
        pixel_angle: Radians that a pixel covers.
    """

    origin: FloatArray
    directions: FloatArray
    hits: Hits
    pixel_angle: float

    @classmethod
    def cast(
        cls,
        scene: Scene,
        camera: CameraModel,
        world_from_camera: RigidTransform,
        column: FloatArray,
        row: FloatArray,
        turn: FloatArray | None,
    ) -> _Rays:
        directions = _directions(camera, world_from_camera, column, row)
        if turn is not None:
            # Small angles: the vehicle turns by a degree at most while a picture is taken.
            angle = row - np.float32((camera.height - 1) / 2)
            directions += np.cross(turn, directions) * angle[:, None]
        origin = world_from_camera.translation.astype(np.float32)
        hits = scene.cast(np.tile(origin, (len(directions), 1)), directions)
        return cls(origin, directions, hits, 1.0 / camera.fx)

    def located(self, scene: Scene, chosen: npt.NDArray[np.integer]) -> Hit:
        """Points and normals of some rays, all of which met something."""
        hits = self.hits
        some = Hits(hits.face[chosen], hits.distance_m[chosen], hits.u[chosen], hits.v[chosen])
        return locate(scene, some, self.origin, self.directions[chosen])


def _radiance(
    scene: Scene, rays: _Rays, openness: FloatArray, shader: Shader, lamps: Lamps, rng: np.random.Generator
) -> FloatArray:
    """Radiance (N, 3) along rays, of which `openness` (N,) is known."""
    radiance = np.empty((len(openness), 3), np.float32)
    # In pieces that fit the processor's cache: shading makes many intermediate columns.
    for start in range(0, len(openness), _PIECE):
        face = rays.hits.face[start : start + _PIECE]
        met, missed = np.flatnonzero(face >= 0) + start, np.flatnonzero(face < 0) + start
        if len(met):
            hit = rays.located(scene, met)
            radiance[met] = shader.shade(scene, hit, openness[met], lamps, rays.pixel_angle, rng)
        if len(missed):
            radiance[missed] = shader.sky(_unit(rays.directions[missed]))
    return radiance


def _directions(
    camera: CameraModel, world_from_camera: RigidTransform, column: FloatArray, row: FloatArray
) -> FloatArray:
    x = (column - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (row - np.float32(camera.cy)) / np.float32(camera.fy)
    right, down, forward = world_from_camera.rotation.T.astype(np.float32)
    # Sums of columns: a product with a matrix of three columns takes several times as long.
    rays = np.empty((len(x), 3), np.float32)
    for axis in range(3):
        rays[:, axis] = x * right[axis] + y * down[axis] + forward[axis]
    return rays


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.sqrt(np.einsum("ni,ni->n", vectors, vectors))[:, None], np.float32)


def _openness(scene: Scene, rays: _Rays, depth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(H, W) share of the sky that each pixel's surface sees: ambient occlusion, near and far."""
    height, width = depth.shape
    index = np.where(rays.hits.face >= 0, np.arange(height * width), -1).reshape(height, width)
    near = _open_share(scene, rays, index[::_NEAR_STEP, ::_NEAR_STEP], _NEAR_M, rng)
    # Houses, woods and roofs hide large parts of the sky from large areas: few rays are enough.
    far = _open_share(scene, rays, index[::_FAR_STEP, ::_FAR_STEP], _FAR_M, rng)
    near, far = (
        cv2.resize(_smooth(share, depth[::step, ::step]), (width, height), interpolation=cv2.INTER_LINEAR)
        for share, step in ((near, _NEAR_STEP), (far, _FAR_STEP))
    )
    return np.asarray((0.08 + 0.92 * near) * (0.08 + 0.92 * far), np.float32)


def _open_share(
    scene: Scene, rays: _Rays, index: npt.NDArray[np.integer], reach_m: float, rng: np.random.Generator
) -> FloatArray:
    """1 where a ray at random got away, 0 where it did not, for pixels (H, W) given by their rays, -1 for the sky's."""
    chosen = np.flatnonzero(index.ravel() >= 0)
    hit = rays.located(scene, index.ravel()[chosen])
    # Origins lifted off the surface, more so far away, where float32 is coarser.
    lift = (np.float32(5e-3) + hit.range_m * np.float32(1e-4))[:, None]
    # Directions on a sphere around the normal's tip are distributed as the light counts: by the cosine.
    scattered = _unit(rng.standard_normal((len(chosen), 3), dtype=np.float32))
    aim = np.ascontiguousarray(hit.normal * np.float32(1.01) + scattered)
    share = np.ones(index.size, np.float32)
    share[chosen] = ~scene.occluded(np.ascontiguousarray(hit.point + hit.normal * lift), aim, reach_m)
    return share.reshape(index.shape)


def _smooth(values: FloatArray, depth: FloatArray) -> FloatArray:
    """Mean over a neighbourhood of 7 x 7, only of pixels at a similar depth."""
    inverse = np.float32(1) / np.minimum(depth, np.float32(1e4))
    smooth = values
    for step in (1, 2, 2):
        total, weights = smooth.copy(), np.ones_like(values)
        for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (-1, 1), (1, -1)):
            shift = (dy * step, dx * step)
            other = _shifted(inverse, shift)
            weight = (np.abs(other - inverse) < 0.06 * inverse).astype(np.float32)
            total += weight * _shifted(smooth, shift)
            weights += weight
        smooth = total / weights
    return smooth


def _shifted(image: npt.NDArray[np.floating], shift: tuple[int, int]) -> FloatArray:
    matrix = np.array([[1, 0, shift[1]], [0, 1, shift[0]]], np.float32)
    size = (image.shape[1], image.shape[0])
    return np.asarray(cv2.warpAffine(image, matrix, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE))


def _edges(scene: Scene, face: npt.NDArray[np.int32], depth: FloatArray) -> npt.NDArray[np.bool_]:
    """(H, W) whether a pixel may show more than one thing."""
    faces = scene.faces
    key = faces.surface[face].astype(np.int32) * 256 + faces.texture[face]
    key[face < 0] = -1
    inverse = np.where(face >= 0, 1.0 / np.maximum(depth, np.float32(1e-3)), np.float32(0))
    edge = np.zeros(face.shape, np.bool_)
    for cells, near, differing in ((edge, inverse, key), (edge.T, inverse.T, key.T)):
        # A plane's inverse depth is linear in the image, so its second difference shows edges only.
        middle = near[1:-1]
        cells[1:-1] |= np.abs(near[:-2] - 2 * middle + near[2:]) > 0.03 * middle
        differs = differing[1:] != differing[:-1]
        cells[1:] |= differs
        cells[:-1] |= differs
    return edge
