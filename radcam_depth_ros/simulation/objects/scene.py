"""Ray casting against the static surroundings and the movers, in two bounding volume hierarchies."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.objects.mesh import Mesh, cross, join

IntArray = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Hits:
    """The first face that each of N rays met.

    Attributes:
        face: (N,) int32, index into the scene's faces, -1 where nothing was met.
        distance_m: (N,) float32, along the ray; +inf where nothing was met.
        u: (N,) float32, barycentric coordinate of the face's second corner.
        v: (N,) float32, of its third corner.
    """

    face: IntArray
    distance_m: FloatArray
    u: FloatArray
    v: FloatArray


class Scene:
    """The world at one time.

    The static part stays while the vehicle moves some way; `set_movers` replaces the moving part. Faces are numbered
    through both, so all their attributes are looked up in one array each.
    """

    def __init__(self, static: Mesh) -> None:
        self._static = _hierarchy(static)
        self._moving: Any = None
        self.faces: Mesh = static
        """Attributes of all faces; those beyond the last one in use are not defined."""
        self.static_count: int = len(static)
        """Number of faces that stand still: the first ones."""
        self.count: int = len(static)
        """Number of faces in use."""
        self.velocity: FloatArray = np.zeros((len(static), 3), np.float32)
        """(F, 3) velocity of each face, m/s in world axes."""
        self.tiles_per_metre: FloatArray = _texture_density(static)
        """(F,) tiles of its texture on a metre of each face."""

    def set_movers(self, movers: list[tuple[Mesh, npt.NDArray[np.floating]]]) -> None:
        """Replaces the moving part by meshes with a velocity (3,) each."""
        moving = join([mesh for mesh, _ in movers])
        self._moving = _hierarchy(moving) if len(moving) else None
        needed = self.static_count + len(moving)
        if needed > len(self.faces):
            self._grow(int(needed * 1.15) + 1000)
        self.count = needed
        tail = slice(self.static_count, needed)
        for entry in fields(Mesh):
            getattr(self.faces, entry.name)[tail] = getattr(moving, entry.name)
        if movers:
            lengths = [len(mesh) for mesh, _ in movers]
            self.tiles_per_metre[tail] = _texture_density(moving)
            self.velocity[tail] = np.repeat(np.array([velocity for _, velocity in movers], np.float32), lengths, axis=0)

    def _grow(self, capacity: int) -> None:
        def longer(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
            grown = np.zeros((capacity, *array.shape[1:]), array.dtype)
            grown[: self.static_count] = array[: self.static_count]
            return grown

        self.faces = self.faces.mapped(longer)
        self.velocity = longer(self.velocity)
        self.tiles_per_metre = longer(self.tiles_per_metre)

    def cast(self, origins: FloatArray, directions: FloatArray) -> Hits:
        """The first face on each ray.

        Args:
            origins: (N, 3) float32, world.
            directions: (N, 3) float32, of any length; distances are multiples of it.
        """
        found = self._static.run(origins, directions, query="INTERSECT", output=1)
        face, distance, u, v = found["primID"], found["tfar"], found["u"], found["v"]
        distance[face < 0] = np.inf
        if self._moving is not None:
            limit = np.where(face < 0, np.float32(1e30), distance).astype(np.float32)
            nearer = self._moving.run(origins, directions, query="INTERSECT", output=1, dists=limit)
            hit = np.flatnonzero(nearer["primID"] >= 0)
            face[hit] = nearer["primID"][hit] + self.static_count
            distance[hit], u[hit], v[hit] = nearer["tfar"][hit], nearer["u"][hit], nearer["v"][hit]
        return Hits(face, distance, u, v)

    def occluded(self, origins: FloatArray, directions: FloatArray, reach: float) -> npt.NDArray[np.bool_]:
        """(N,) whether anything lies on each ray within `reach` multiples of its direction."""
        limit = np.full(len(origins), reach, np.float32)
        hidden = np.asarray(self._static.run(origins, directions, query="OCCLUDED", dists=limit)) >= 0
        if self._moving is not None:
            hidden |= np.asarray(self._moving.run(origins, directions, query="OCCLUDED", dists=limit)) >= 0
        return hidden


def _texture_density(mesh: Mesh) -> FloatArray:
    edges, steps = mesh.corners[:, 1:] - mesh.corners[:, :1], mesh.uv[:, 1:] - mesh.uv[:, :1]
    area = np.linalg.norm(cross(edges[:, 0], edges[:, 1]), axis=1)
    tiles = np.abs(steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0])
    return np.asarray(np.sqrt(tiles / (area + 1e-12)), np.float32)


def _hierarchy(mesh: Mesh) -> Any:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.corners))
    return scene
