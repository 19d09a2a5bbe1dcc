"""The camera: radiance, exact depth and classes of one view."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import CameraModel, FloatArray, ImageArray
from radcam_depth_ros.geometry import RigidTransform
from radcam_depth_ros.simulation.lamps import Lamps, shining_lamps
from radcam_depth_ros.simulation.scene import Hits, Scene
from radcam_depth_ros.simulation.shading import Hit, Shader, locate
from radcam_depth_ros.simulation.surfaces import Label

_NEAR_M, _FAR_M = 3.0, 60.0
_FAR_STEP = 4
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
) -> View:
    """Renders a view; the camera's axes are x right, y down, z forward."""
    height, width = camera.height, camera.width
    column, row = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    directions = _directions(camera, world_from_camera, column.ravel(), row.ravel())
    origin = world_from_camera.translation.astype(np.float32)
    hits = scene.cast(np.tile(origin, (len(directions), 1)), directions)
    # Directions have z = 1 in camera axes, so the distance along them is the depth.
    depth = hits.distance_m.reshape(height, width)
    met = np.flatnonzero(hits.face >= 0)
    label = np.full(height * width, Label.SKY, np.uint8)
    label[met] = scene.faces.label[hits.face[met]]
    hit = locate(scene, _some(hits, met), origin, directions[met])
    openness = _openness(scene, hit, met, depth, rng)
    lamps = shining_lamps(scene, shader.light, world_from_camera)
    pixel_angle = 1.0 / camera.fx
    radiance = np.empty((height * width, 3), np.float32)
    radiance[met] = shader.shade(scene, hit, openness.ravel()[met], lamps, pixel_angle, rng)
    missed = np.flatnonzero(hits.face < 0)
    radiance[missed] = shader.sky(_unit(directions[missed]))
    if edge_samples > 0:
        edges = np.flatnonzero(_edges(scene, hits.face.reshape(height, width), depth).ravel())
        total = radiance[edges]
        for dx, dy in _SUBPIXELS[:edge_samples]:
            total = total + _sample(
                scene,
                camera,
                world_from_camera,
                shader,
                column.ravel()[edges] + np.float32(dx),
                row.ravel()[edges] + np.float32(dy),
                openness.ravel()[edges],
                lamps,
                rng,
            )
        radiance[edges] = total / (1 + min(edge_samples, len(_SUBPIXELS)))
    velocity = np.zeros((height * width, 3), np.float32)
    moving = met[hit.face >= scene.static_count]
    velocity[moving] = scene.velocity[hits.face[moving]]
    return View(
        radiance.reshape(height, width, 3),
        depth,
        label.reshape(height, width),
        velocity.reshape(height, width, 3),
    )


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
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float32)


def _some(hits: Hits, chosen: npt.NDArray[np.integer]) -> Hits:
    return Hits(hits.face[chosen], hits.distance_m[chosen], hits.u[chosen], hits.v[chosen])


def _sample(
    scene: Scene,
    camera: CameraModel,
    world_from_camera: RigidTransform,
    shader: Shader,
    column: FloatArray,
    row: FloatArray,
    openness: FloatArray,
    lamps: Lamps,
    rng: np.random.Generator,
) -> FloatArray:
    """Radiance (N, 3) at places (N,) of the image."""
    directions = _directions(camera, world_from_camera, column, row)
    origin = world_from_camera.translation.astype(np.float32)
    hits = scene.cast(np.tile(origin, (len(directions), 1)), directions)
    met, missed = np.flatnonzero(hits.face >= 0), np.flatnonzero(hits.face < 0)
    radiance = np.empty((len(column), 3), np.float32)
    hit = locate(scene, _some(hits, met), origin, directions[met])
    radiance[met] = shader.shade(scene, hit, openness[met], lamps, 1.0 / camera.fx, rng)
    radiance[missed] = shader.sky(_unit(directions[missed]))
    return radiance


def _openness(
    scene: Scene, hit: Hit, met: npt.NDArray[np.integer], depth: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(H, W) share of the sky that each pixel's surface sees: ambient occlusion, near and far."""
    height, width = depth.shape
    index = np.full(height * width, -1, np.int64)
    index[met] = np.arange(len(met))
    index = index.reshape(height, width)
    near = _open_share(scene, hit, index[::2, ::2], _NEAR_M, rng)
    # Houses, woods and roofs hide large parts of the sky from large areas: few rays are enough.
    far = _open_share(scene, hit, index[::_FAR_STEP, ::_FAR_STEP], _FAR_M, rng)
    near, far = (
        cv2.resize(_smooth(share, depth[::step, ::step]), (width, height), interpolation=cv2.INTER_LINEAR)
        for share, step in ((near, 2), (far, _FAR_STEP))
    )
    return np.asarray((0.08 + 0.92 * near) * (0.08 + 0.92 * far), np.float32)


def _open_share(
    scene: Scene, hit: Hit, index: npt.NDArray[np.integer], reach_m: float, rng: np.random.Generator
) -> FloatArray:
    """1 where a ray at random got away, 0 where it did not, for pixels (H, W) given by `index` into the hits."""
    chosen = np.flatnonzero(index.ravel() >= 0)
    rays = index.ravel()[chosen]
    # Origins lifted off the surface, more so far away, where float32 is coarser.
    lift = (np.float32(5e-3) + hit.range_m[rays] * np.float32(1e-4))[:, None]
    origins = np.ascontiguousarray(hit.point[rays] + hit.normal[rays] * lift)
    # Directions on a sphere around the normal's tip are distributed as the light counts: by the cosine.
    scattered = _unit(rng.standard_normal((len(rays), 3), dtype=np.float32))
    aim = np.ascontiguousarray(hit.normal[rays] * np.float32(1.01) + scattered)
    share = np.ones(index.size, np.float32)
    share[chosen] = ~scene.occluded(origins, aim, reach_m)
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
    # A plane's inverse depth is linear in the image, so its second difference shows edges only.
    bend = np.abs(inverse[:, :-2] - 2 * inverse[:, 1:-1] + inverse[:, 2:]) > 0.03 * inverse[:, 1:-1]
    edge[:, 1:-1] |= bend
    bend = np.abs(inverse[:-2] - 2 * inverse[1:-1] + inverse[2:]) > 0.03 * inverse[1:-1]
    edge[1:-1] |= bend
    differs = key[:, 1:] != key[:, :-1]
    edge[:, 1:] |= differs
    edge[:, :-1] |= differs
    differs = key[1:] != key[:-1]
    edge[1:] |= differs
    edge[:-1] |= differs
    return edge
