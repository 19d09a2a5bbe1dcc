"""Triangle meshes with the attributes that sensors need, and the simple shapes that objects are built from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture

Corner = tuple[float, float, float]
ByteArray = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Mesh:
    """F triangles without shared corners; x forward, y left, z up, metres.

    Attributes:
        corners: (F, 3, 3) float32.
        normals: (F, 3, 3) float32, unit shading normals at the corners.
        uv: (F, 3, 2) float32, texture coordinates in tiles.
        colour: (F, 3) float32, linear RGB.
        texture: (F,) uint8, values of `Texture`.
        surface: (F,) uint8, values of `Surface`.
        label: (F,) uint8, values of `Label`.
    """

    corners: FloatArray
    normals: FloatArray
    uv: FloatArray
    colour: FloatArray
    texture: ByteArray
    surface: ByteArray
    label: ByteArray

    def __len__(self) -> int:
        return len(self.corners)

    def moved(
        self, position: Sequence[float], yaw: float = 0.0, scale: float | tuple[float, float, float] = 1.0
    ) -> Mesh:
        """The mesh scaled about its origin, turned about z and put at a position (normals ignore uneven scaling)."""
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]], np.float32)
        corners = (self.corners * np.asarray(scale, np.float32)) @ turn + np.asarray(position, np.float32)
        return replace(self, corners=corners.astype(np.float32, copy=False), normals=self.normals @ turn)

    def swung(self, angle: float, pivot_z: float) -> Mesh:
        """The mesh turned about the y axis through height `pivot_z`; a positive angle moves what is below forwards."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]], np.float32)
        pivot = np.array([0.0, 0.0, pivot_z], np.float32)
        corners = np.asarray((self.corners - pivot) @ turn + pivot, np.float32)
        return replace(self, corners=corners, normals=self.normals @ turn)

    def recoloured(self, surface: Surface, colour: npt.ArrayLike) -> Mesh:
        """The mesh with all faces of one surface in another colour."""
        chosen = (self.surface == surface)[:, None]
        return replace(self, colour=np.where(chosen, np.asarray(colour, np.float32), self.colour))

    def with_axes(self, *order: int) -> Mesh:
        """The mesh with its axes in another order: (0, 2, 1) lays an upright mesh on its side."""
        corners, normals = (np.ascontiguousarray(part[..., order]) for part in (self.corners, self.normals))
        return replace(self, corners=corners, normals=normals)

    def mapped(self, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Mesh:
        """The mesh with each of its arrays changed."""
        return Mesh(**{field.name: change(getattr(self, field.name)) for field in fields(Mesh)})


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of several, in order; of none, an empty one."""
    if not meshes:
        return _from_corners(np.zeros((0, 3, 3)), np.zeros((0, 3, 2)), Material(Surface.METAL, Label.IGNORE))
    names = [field.name for field in fields(Mesh)]
    return Mesh(**{name: np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in names})


def quads(corners: npt.ArrayLike, material: Material, uv: npt.ArrayLike | None = None) -> Mesh:
    """Flat four-cornered faces.

    Args:
        corners: (Q, 4, 3) metres, in order around each face.
        material: Their look.
        uv: (Q, 4, 2) in tiles; by default metres along the first edge and across it, over `material.tile_m`.
    """
    points = np.asarray(corners, np.float64).reshape(-1, 4, 3)
    if uv is None:
        along = points[:, 1] - points[:, 0]
        along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
        normal = cross(along, points[:, 3] - points[:, 0])
        across = cross(normal / (np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12), along)
        offset = points - points[:, :1]
        texture = np.stack([np.einsum("qki,qi->qk", offset, along), np.einsum("qki,qi->qk", offset, across)], -1)
        texture /= material.tile_m
    else:
        texture = np.asarray(uv, np.float64).reshape(-1, 4, 2)
    split = np.array([[0, 1, 2], [0, 2, 3]])
    return _from_corners(points[:, split].reshape(-1, 3, 3), texture[:, split].reshape(-1, 3, 2), material)


def pane(low: Corner, high: Corner) -> list[Corner]:
    """Corners of an upright face from -y to y; `low` and `high` are the ends of its lower and upper edge."""
    return [(low[0], -low[1], low[2]), low, high, (high[0], -high[1], high[2])]


def box(size: Sequence[float], centre: Sequence[float], material: Material, top: Sequence[float] = (1.0, 1.0)) -> Mesh:
    """A box; `top` scales its upper face about the middle, for roofs and tapered posts."""
    half = np.asarray(size, np.float64) / 2
    plan = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
    low = np.column_stack([plan, np.full(4, -half[2])])
    high = np.column_stack([plan * np.asarray(top), np.full(4, half[2])])
    sides = [[low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]] for i in range(4)]
    faces = np.array([*sides, list(high), list(low[::-1])]) + np.asarray(centre, np.float64)
    return quads(faces, material)


def prism(
    profile: npt.ArrayLike,
    width: float,
    material: Material,
    top_width: float | None = None,
    bulge: float = 0.0,
    flank: Texture | None = None,
) -> Mesh:
    """A side profile drawn out across the vehicle, narrowing with height.

    Args:
        profile: (N, 2) x and z of the corners, in order.
        width: Metres across at the lowest corner.
        material: Its look.
        top_width: Metres across at the highest corner; by default `width`.
        bulge: How far the middle of front and back stands out, metres: rounds the corners seen from above.
        flank: Texture of both flanks, which one tile covers, upright; by default the material's.
    """
    outline = np.asarray(profile, np.float64)
    low, high = outline[:, 1].min(), outline[:, 1].max()
    upper = width if top_width is None else top_width
    half = (width + (upper - width) * (outline[:, 1] - low) / max(high - low, 1e-9)) / 2
    lanes = np.array([-1.0, -0.7, 0.7, 1.0]) if bulge > 0 else np.array([-1.0, 1.0])
    middle = outline[:, 0].mean()
    reach = np.clip(np.abs(outline[:, 0] - middle) / max(np.ptp(outline[:, 0]) / 2, 1e-9), 0, 1) ** 4
    push = -np.sign(outline[:, 0] - middle) * reach * bulge
    x, z = outline.T
    rows = np.stack([np.column_stack([x + (push if abs(lane) > 0.9 else 0), lane * half, z]) for lane in lanes])
    after = np.roll(rows, -1, axis=1)
    skin = np.stack([rows[:-1], after[:-1], after[1:], rows[1:]], axis=2).reshape(-1, 4, 3)
    caps = []
    for side, order in ((rows[0], (0, 2, 1, 1)), (rows[-1], (0, 1, 2, 2))):
        centre = np.broadcast_to(side.mean(axis=0), side.shape)
        fan = (centre, side, np.roll(side, -1, axis=0))
        caps.append(np.stack([fan[k] for k in order], axis=1))
    if flank is None:
        return _without_slivers(quads(np.concatenate([skin, *caps]), material))
    sides = np.stack(caps)
    across = (sides[..., 0] - x.min()) / max(np.ptp(x), 1e-9)
    # Seen from the left the vehicle drives to the left.
    across[1] = 1 - across[1]
    uv = np.stack([across, 1 - (sides[..., 2] - low) / max(high - low, 1e-9)], axis=-1)
    lettered = quads(sides, replace(material, texture=flank), uv)
    return _without_slivers(join([quads(skin, material), lettered]))


def _without_slivers(mesh: Mesh) -> Mesh:
    """Without the faces of no area that remain where corners of a quad meet."""
    edges = mesh.corners[:, 1:] - mesh.corners[:, :1]
    keep = np.linalg.norm(cross(edges[:, 0], edges[:, 1]), axis=1) > 1e-7
    return mesh.mapped(lambda values: values[keep])


def revolved(
    profile: npt.ArrayLike, material: Material, sections: int = 10, scale: Sequence[float] = (1.0, 1.0, 1.0)
) -> Mesh:
    """A surface of revolution about z with smooth normals.

    Args:
        profile: (N, 2) radius and height, from bottom to top.
        material: Its look.
        sections: Faces around.
        scale: Stretches x, y, z.
    """
    outline = np.asarray(profile, np.float64)
    angle = np.linspace(0, 2 * np.pi, sections + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    slope, shape = np.gradient(outline, axis=0), (len(outline), sections + 1, 1)
    points = np.concatenate([outline[:, None, :1] * ring[None], np.broadcast_to(outline[:, None, 1:], shape)], -1)
    normal = np.concatenate([slope[:, None, 1:] * ring[None], np.broadcast_to(-slope[:, None, :1], shape)], -1)
    stretch = np.asarray(scale, np.float64)
    length = 2 * np.pi * outline[:, 0].max() / material.tile_m
    around, along = (angle / (2 * np.pi) * length)[None], (outline[:, 1] / material.tile_m)[:, None]
    uv = np.stack(np.broadcast_arrays(around, along), -1)
    return _without_slivers(sheet(points * stretch, material, uv, normal / stretch))


def tube(radius: float, length: float, material: Material, sections: int = 8, top_radius: float | None = None) -> Mesh:
    """A closed upright cylinder or cone standing on the origin."""
    upper = radius if top_radius is None else top_radius
    side = revolved([[radius, 0.0], [upper, length]], material, sections)
    lid = revolved([[upper, length], [0.0, length]], material, sections)
    return join([side, lid])


def ball(
    radius: float, centre: Sequence[float], material: Material, scale: Sequence[float] = (1, 1, 1), sections: int = 8
) -> Mesh:
    """A sphere, stretched about its centre."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, max(sections // 2, 3) + 1)
    return revolved(np.column_stack([np.cos(angle), np.sin(angle)]) * radius, material, sections, scale).moved(centre)


def sheet(
    points: npt.NDArray[np.floating],
    material: Material,
    uv: npt.NDArray[np.floating] | None = None,
    normals: npt.NDArray[np.floating] | None = None,
) -> Mesh:
    """A grid of points as a surface.

    Args:
        points: (N, M, 3) metres; seen from the side where N x M turns counter-clockwise.
        material: Its look.
        uv: (N, M, 2) in tiles; by default x and y over `material.tile_m`.
        normals: (N, M, 3), need not be of unit length; by default those of the flat faces.
    """
    texture = points[..., :2] / material.tile_m if uv is None else uv
    mesh = _from_corners(_grid_faces(points), _grid_faces(texture), material)
    if normals is None:
        return mesh
    smooth = _grid_faces(normals)
    smooth = smooth / (np.linalg.norm(smooth, axis=-1, keepdims=True) + 1e-12)
    return replace(mesh, normals=smooth.astype(np.float32))


def cross(a: npt.NDArray[np.floating], b: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Cross products of rows (N, 3); numpy's own takes several times as long for few rows."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    product[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    product[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    product[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def _grid_faces(grid: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    faces = np.stack([np.stack([a, b, c], 2), np.stack([a, c, d], 2)], 2)
    return faces.reshape(-1, 3, grid.shape[-1])


def _from_corners(corners: npt.NDArray[np.floating], uv: npt.NDArray[np.floating], material: Material) -> Mesh:
    count = len(corners)
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = normal / (np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12)
    return Mesh(
        np.ascontiguousarray(corners, np.float32),
        np.repeat(normal[:, None], 3, axis=1).astype(np.float32),
        np.ascontiguousarray(uv, np.float32),
        np.tile(np.asarray(material.colour, np.float32), (count, 1)),
        np.full(count, material.texture, np.uint8),
        np.full(count, material.surface, np.uint8),
        np.full(count, material.label, np.uint8),
    )
