"""One stretch of street while it is being built: where things are put, and at which height."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.materials.surfaces import Material
from radcam_depth_ros.simulation.objects.library import Library
from radcam_depth_ros.simulation.objects.mesh import Mesh, join, sheet
from radcam_depth_ros.simulation.settings.style import Land, Side, StreetStyle
from radcam_depth_ros.simulation.world.path import Path

STRETCH_M = 50.0
"""Length of a stretch."""

LAND_REACH_M = 90.0
"""How far the land beside the road is modelled."""

STATION_STEP_M = 5.0
"""Between the rows of what is laid along the road."""

_PIECE_M = 6.25


@dataclass
class Stretch:
    """A stretch while it is being built.

    Attributes:
        start_m: `s` where it begins.
        path: The centre line.
        style: The street's style.
        library: Prototypes.
        rng: Random generator of this stretch.
        people: Multiple of the usual number of people.
        crossing_m: `s` of a side road in this stretch, NaN where there is none.
        land: What lies on the left (1) and on the right (-1).
        is_covered: Whether the road runs through a tunnel.
        parts: What was placed so far.
    """

    start_m: float
    path: Path
    style: StreetStyle
    library: Library
    rng: np.random.Generator
    people: float
    crossing_m: float = float("nan")
    land: dict[int, Land] = field(default_factory=dict)
    is_covered: bool = False
    parts: list[Mesh] = field(default_factory=list)

    @property
    def stop_m(self) -> float:
        """`s` where it ends."""
        return self.start_m + STRETCH_M

    def side(self, sign: int) -> tuple[Side, float]:
        """A side of the road (1 left, -1 right) and the distance of the asphalt's edge from the centre line."""
        if sign > 0:
            return self.style.left, self.style.left_edge_m
        return self.style.right, self.style.right_edge_m

    def crosses(self, start: float, stop: float) -> bool:
        """Whether something from `start` to `stop` would stand on the side road."""
        clearance = self.style.crossing_half_m + 2.4
        return bool(start < self.crossing_m + clearance and stop > self.crossing_m - clearance)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """What is beside the road less the side road, from and to `s`."""
        if not np.isfinite(self.crossing_m):
            return [(self.start_m, self.stop_m)]
        half = self.style.crossing_half_m
        return [(self.start_m, self.crossing_m - half), (self.crossing_m + half, self.stop_m)]

    def ground_m(
        self, sign: int, s: npt.ArrayLike, outwards: npt.ArrayLike, ditch: bool = True
    ) -> npt.NDArray[np.float64]:
        """Height of the land at a distance outwards from where the land begins, with its ditch or across it."""
        side, _ = self.side(sign)
        along, reach = np.asarray(s, np.float64), np.asarray(outwards, np.float64)
        rise = np.clip((reach - 1.0) / 9.0, 0, 1) * np.clip((LAND_REACH_M - 20 - reach) / 25.0, 0, 1)
        wave = 0.6 + 0.4 * np.sin(along / 47.0 + sign) + 0.25 * np.sin(along / 19.0 + reach / 11.0)
        base = self.style.kerb_m if side.walk_m > 0 else -0.02
        # A ditch is as deep near the side road as the pipe below that is wide: not at all.
        gap = np.abs(along - self.crossing_m) - self.style.crossing_half_m if np.isfinite(self.crossing_m) else 9.0
        hollow = side.ditch_m * np.exp(-(((reach - 2.4) / 0.9) ** 2)) * np.clip(np.asarray(gap) / 4, 0, 1) * ditch
        return np.asarray(base + side.bank_m * rise * wave - hollow, np.float64)

    def place(
        self,
        mesh: Mesh,
        s: float,
        t: float,
        z: float = 0.0,
        yaw: float = 0.0,
        scale: float | tuple[float, float, float] = 1.0,
    ) -> None:
        """Puts a mesh at a place of the road, its x axis along the road for `yaw` 0."""
        x, y = self.path.position(s, t)
        moved = mesh.moved((float(x), float(y), z), float(self.path.heading(s)) + yaw, scale)
        self.parts.append(self.path.tilted(moved, s, t))

    def place_along(
        self,
        build: Callable[[float], Mesh],
        sign: int,
        start: float,
        stop: float,
        t: float,
        z: Callable[[float], float] | float = 0.0,
    ) -> None:
        """Puts something long along the road in short straight pieces, so that it follows curves and slopes.

        Args:
            build: Makes a piece of a length along x from the origin on, its front towards -y.
            sign: 1 where its front is towards the right, -1 where it is towards the left.
            start: From this `s`
            stop: to this.
            t: Offset from the centre line.
            z: Height, or its height at each `s`.
        """
        count = max(1, round((stop - start) / _PIECE_M))
        places = np.linspace(start, stop, count + 1)
        for low, high in pairwise(places.tolist()):
            first, last = (low, high) if sign > 0 else (high, low)
            (x0, y0), (x1, y1) = self.path.position([first, last], t)
            z0, z1 = (float(z(float(s))) if callable(z) else z for s in (first, last))
            chord = float(np.hypot(x1 - x0, y1 - y0))
            piece = build(chord)
            rising = piece.corners.copy()
            rising[..., 2] += rising[..., 0] * np.float32((z1 - z0) / chord)
            piece = replace(piece, corners=rising).moved((x0, y0, z0), float(np.arctan2(y1 - y0, x1 - x0)))
            self.parts.append(self.path.tilted(piece, float(low + high) / 2, t))

    def place_facing_road(self, mesh: Mesh, sign: int, s: float, outwards: float, depth: float = 0.0) -> None:
        """Puts a mesh whose front is at y = 0 beside the road, the front towards the road, on the land's height."""
        _, edge = self.side(sign)
        side, _ = self.side(sign)
        z = float(self.ground_m(sign, s, outwards - side.land_m + depth / 2)) - 0.05
        # Along the chord, so that a long front does not come near the road in a curve.
        t, reach = sign * (edge + outwards), float(mesh.corners[..., 0].max()) * sign
        (x0, y0), (x1, y1) = self.path.position([s, s + reach], t)
        bend = float(np.arctan2(y1 - y0, x1 - x0)) - float(self.path.heading(s))
        self.place(mesh, s, t, z, bend)

    def strip(
        self,
        t0: float,
        t1: float,
        z: npt.ArrayLike,
        material: Material,
        start: float | None = None,
        stop: float | None = None,
    ) -> None:
        """A band along the road between two offsets, at one height or rising from the first to the second."""
        first = self.start_m if start is None else start
        last = self.stop_m if stop is None else stop
        s = np.linspace(first, last, max(2, int(np.ceil((last - first) / STATION_STEP_M)) + 1))
        heights = np.broadcast_to(np.asarray(z, np.float64), (2,))
        self.grid(s, np.array([t0, t1]), np.broadcast_to(heights, (len(s), 2)), material)

    def grid(
        self, s: npt.NDArray[np.floating], t: npt.NDArray[np.floating], z: npt.NDArray[np.floating], material: Material
    ) -> None:
        """A surface over a grid of places; z is (len(s), len(t))."""
        along, across = np.meshgrid(s, t, indexing="ij")
        height = z + self.path.camber(along, across)
        points = np.concatenate([self.path.position(along, across), height[..., None]], axis=-1)
        uv = np.stack([across, along], axis=-1) / material.tile_m
        self.parts.append(sheet(points, material, uv))


def finished(stretch: Stretch) -> Mesh:
    """All that was placed, as one mesh."""
    return join(stretch.parts)
