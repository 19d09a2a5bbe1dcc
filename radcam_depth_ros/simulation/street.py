"""One stretch of street: road, markings, kerbs, what stands and parks beside them, and the land behind."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation import furniture
from radcam_depth_ros.simulation.configuration import StreetKind
from radcam_depth_ros.simulation.library import Library
from radcam_depth_ros.simulation.mesh import Mesh, join, sheet
from radcam_depth_ros.simulation.path import Path
from radcam_depth_ros.simulation.style import Colour, Side, StreetStyle
from radcam_depth_ros.simulation.surfaces import Label, Material, Surface, Texture

STRETCH_M = 50.0
"""Length of a stretch."""

LAND_REACH_M = 90.0
"""How far the land beside the road is modelled."""

_STEP_M = 5.0


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
        parts: What was placed so far.
    """

    start_m: float
    path: Path
    style: StreetStyle
    library: Library
    rng: np.random.Generator
    people: float
    crossing_m: float = float("nan")
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

    def crosses(self, start: float, stop: float, clearance: float = 6.0) -> bool:
        """Whether something from `start` to `stop` would stand on the side road."""
        return bool(start < self.crossing_m + clearance and stop > self.crossing_m - clearance)

    def ground_m(self, sign: int, s: npt.ArrayLike, outwards: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Height of the land at a distance outwards from where the land begins."""
        side, _ = self.side(sign)
        along, reach = np.asarray(s, np.float64), np.asarray(outwards, np.float64)
        rise = np.clip((reach - 1.0) / 9.0, 0, 1) * np.clip((LAND_REACH_M - 20 - reach) / 25.0, 0, 1)
        wave = 0.6 + 0.4 * np.sin(along / 47.0 + sign) + 0.25 * np.sin(along / 19.0 + reach / 11.0)
        base = self.style.kerb_m if side.walk_m > 0 else -0.02
        return base + side.bank_m * rise * wave

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
        self.parts.append(mesh.moved((float(x), float(y), z), float(self.path.heading(s)) + yaw, scale))

    def place_facing_road(self, mesh: Mesh, sign: int, s: float, outwards: float, depth: float = 0.0) -> None:
        """Puts a mesh whose front is at y = 0 beside the road, the front towards the road, on the land's height."""
        _, edge = self.side(sign)
        side, _ = self.side(sign)
        z = float(self.ground_m(sign, s, outwards - side.land_m + depth / 2)) - 0.05
        self.place(mesh, s, sign * (edge + outwards), z, 0.0 if sign > 0 else np.pi)

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
        s = np.linspace(first, last, max(2, int(np.ceil((last - first) / _STEP_M)) + 1))
        heights = np.broadcast_to(np.asarray(z, np.float64), (2,))
        self.grid(s, np.array([t0, t1]), np.broadcast_to(heights, (len(s), 2)), material)

    def grid(
        self, s: npt.NDArray[np.floating], t: npt.NDArray[np.floating], z: npt.NDArray[np.floating], material: Material
    ) -> None:
        """A surface over a grid of places; z is (len(s), len(t))."""
        along, across = np.meshgrid(s, t, indexing="ij")
        points = np.concatenate([self.path.position(along, across), z[..., None]], axis=-1)
        uv = np.stack([across, along], axis=-1) / material.tile_m
        self.parts.append(sheet(points, material, uv))


def lay_ground(stretch: Stretch) -> None:
    """Road, kerbs, sidewalks, verges and the land's surface."""
    style, rng = stretch.style, stretch.rng
    texture = Texture.ASPHALT_PATCHED if rng.random() < 0.4 else Texture.ASPHALT
    tone = style.asphalt * float(np.exp(rng.normal(0, 0.06)))
    road = Material(Surface.ASPHALT, Label.ROAD, _grey(tone, rng), texture, float(rng.uniform(5, 9)))
    half = style.median_m / 2
    stretch.strip(-style.right_edge_m, style.left_edge_m, 0.0, road)
    if style.median_m > 0:
        _median(stretch, half)
    _repairs(stretch, tone)
    grass = Material(Surface.GROUND, Label.TERRAIN, style.grass, Texture.GRASS, 6.0)
    soil = Material(Surface.GROUND, Label.TERRAIN, _muted(style.grass), Texture.SOIL, 7.0)
    snow = Material(Surface.GROUND, Label.TERRAIN, (0.9, 0.92, 0.95), Texture.SNOW, 9.0)
    paved = Material(
        Surface.PAVING,
        Label.SIDEWALK,
        _grey(float(np.clip(style.asphalt * rng.uniform(0.7, 3.0), 0.06, 0.55)), rng),
        [Texture.PAVING, Texture.ASPHALT, Texture.COBBLES][int(rng.choice(3, p=[0.5, 0.3, 0.2]))],
        3.0,
    )
    for sign in (1, -1):
        side, edge = stretch.side(sign)
        ground = snow if style.snow and rng.random() < 0.8 else (soil if rng.random() < 0.25 else grass)
        if side.parking_m > 0:
            lane = Material(
                Surface.PAVING,
                Label.ROAD,
                _grey(tone * rng.uniform(0.8, 1.4), rng),
                Texture.COBBLES if rng.random() < 0.3 else texture,
                4.0,
            )
            stretch.strip(sign * edge, sign * (edge + side.parking_m), 0.0, lane)
        if side.walk_m > 0:
            stone = Material(Surface.PAVING, Label.SIDEWALK, _grey(0.3, rng), Texture.PLAIN)
            at, lift = edge + side.parking_m, style.kerb_m
            stretch.strip(sign * at, sign * (at + 0.02), (0.0, lift), stone)
            stretch.strip(sign * (at + 0.02), sign * (at + 0.16), lift, stone)
            stretch.strip(sign * (at + 0.16), sign * (edge + side.land_m), lift, paved)
            if side.verge_m > 0.3:
                stretch.strip(sign * (at + 0.3), sign * (edge + side.walk_start_m), lift + 0.03, ground)
        elif style.snow or rng.random() < 0.4:
            # Gravel, dirt or ploughed snow hides the straight edge of the asphalt.
            stretch.strip(
                sign * (edge - rng.uniform(0, 0.3)),
                sign * (edge + rng.uniform(0.3, 1.5)),
                (0.012, 0.03),
                soil if not style.snow else snow,
            )
        _land_surface(stretch, sign, ground)


def _land_surface(stretch: Stretch, sign: int, material: Material) -> None:
    side, edge = stretch.side(sign)
    reach = np.array([-0.3, 1.0, 3.0, 6.0, 10.0, 16.0, 25.0, 38.0, 52.0, 70.0, LAND_REACH_M])
    s = np.linspace(stretch.start_m, stretch.stop_m, int(STRETCH_M / _STEP_M) + 1)
    along, outwards = np.meshgrid(s, reach, indexing="ij")
    z = stretch.ground_m(sign, along, outwards) - 0.02
    z += 0.06 * np.sin(along * 1.1 + outwards * 0.7) * (outwards > 2)
    stretch.grid(s, sign * (edge + side.land_m + reach), z, material)


def _median(stretch: Stretch, half: float) -> None:
    style, rng = stretch.style, stretch.rng
    grown = Material(
        Surface.GROUND,
        Label.TERRAIN,
        (0.85, 0.87, 0.9) if style.snow else style.grass,
        Texture.SNOW if style.snow else Texture.GRASS,
        5.0,
    )
    inner = half - 0.35
    stretch.strip(-inner, inner, style.kerb_m, grown)
    for sign in (1, -1):
        stone = Material(Surface.PAVING, Label.TERRAIN, _grey(0.3, rng))
        stretch.strip(sign * inner, sign * (inner + 0.03), (style.kerb_m, 0.0), stone)
    if style.kind is StreetKind.HIGHWAY:
        if style.lanes % 2:
            stretch.place(furniture.concrete_barrier(STRETCH_M), stretch.start_m, 0.0, style.kerb_m)
        else:
            rail = furniture.guard_rail(STRETCH_M)
            stretch.place(rail, stretch.start_m, -0.3, style.kerb_m)
            stretch.place(rail, stretch.stop_m, 0.3, style.kerb_m, np.pi)
    elif half > 1.0:
        for s in np.arange(stretch.start_m + 3, stretch.stop_m, rng.uniform(7, 25)):
            if rng.random() < 0.7:
                plant = (
                    stretch.library.draw_tree(rng, style)
                    if rng.random() < 0.5
                    else stretch.library.draw_bush(rng, style)
                )
                stretch.place(plant.near, float(s), 0.0, style.kerb_m, rng.uniform(0, 6.28), rng.uniform(0.6, 1.0))


def _repairs(stretch: Stretch, tone: float) -> None:
    """Patches of newer or older asphalt, seams between lanes, manholes: the road's own changes of brightness."""
    rng, style = stretch.rng, stretch.style
    low, high = -style.right_edge_m, style.left_edge_m
    if rng.random() < 0.3:
        lane = -float(rng.integers(0, style.lanes)) * style.lane_m - style.median_m / 2
        material = Material(
            Surface.ASPHALT, Label.ROAD, _grey(tone * float(np.exp(rng.normal(0, 0.35))), rng), Texture.ASPHALT, 7.0
        )
        stretch.strip(lane - style.lane_m, lane, 0.0025, material)
    for _ in range(int(rng.poisson(1.5))):
        s, t = rng.uniform(stretch.start_m, stretch.stop_m - 9), rng.uniform(low, high - 1.5)
        material = Material(
            Surface.ASPHALT, Label.ROAD, _grey(tone * float(np.exp(rng.normal(-0.1, 0.4))), rng), Texture.ASPHALT, 6.0
        )
        stretch.strip(t, min(t + rng.uniform(0.6, 3.5), high), 0.004, material, s, s + rng.uniform(1.5, 9))
    iron = Material(Surface.METAL, Label.ROAD, _grey(tone * float(rng.uniform(0.4, 0.9)), rng), Texture.METAL)
    for _ in range(int(rng.poisson(0.8))):
        s, t = rng.uniform(stretch.start_m, stretch.stop_m - 1), rng.uniform(low + 0.5, high - 1)
        stretch.strip(t, t + 0.6, 0.005, iron, s, s + 0.6)


def _grey(tone: float, rng: np.random.Generator) -> Colour:
    shift = float(rng.normal(0, 0.02))
    return tone * (1 + shift), tone, tone * (1 - shift)


def _muted(colour: Colour) -> Colour:
    r, g, b = colour
    mean = (r + g + b) / 3
    return mean * 1.25, mean * 1.0, mean * 0.72


def finished(stretch: Stretch) -> Mesh:
    """All that was placed, as one mesh."""
    return join(stretch.parts)
