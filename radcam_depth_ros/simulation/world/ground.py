"""The ground of a stretch: road and its repairs, kerbs, sidewalks, verges, the land's surface, side roads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects import furniture
from radcam_depth_ros.simulation.objects.mesh import sheet
from radcam_depth_ros.simulation.settings.configuration import Season, StreetKind
from radcam_depth_ros.simulation.settings.style import Colour, Land
from radcam_depth_ros.simulation.world.street import LAND_REACH_M, STATION_STEP_M, Stretch


def lay_ground(stretch: Stretch) -> None:
    """Road, kerbs, sidewalks, verges and the land's surface."""
    style, rng = stretch.style, stretch.rng
    texture = style.road if rng.random() < 0.88 else Texture.ASPHALT_PATCHED
    tone = style.asphalt * float(np.exp(rng.normal(0, 0.06)))
    road = Material(Surface.ASPHALT, Label.ROAD, _grey(tone, rng), texture, style.road_tile_m)
    stretch.strip(-style.right_edge_m, style.left_edge_m, 0.0, road)
    if style.median_m > 0:
        _median(stretch, style.median_m / 2)
    _repairs(stretch, tone)
    for sign in (1, -1):
        if stretch.is_covered:
            continue
        ground = _grown(stretch)
        if stretch.side(sign)[0].walk_m > 0:
            _sidewalk(stretch, sign, ground, road)
        elif style.kind is not StreetKind.CAR_PARK and (style.snow or rng.random() < 0.5):
            _verge(stretch, sign)
        if stretch.land[sign] in (Land.LOT, Land.OPEN):
            ground = _sealed(stretch, tone)
        _land_surface(stretch, sign, ground)
    if np.isfinite(stretch.crossing_m) and not stretch.is_covered:
        _side_road(stretch, tone)


def _grown(stretch: Stretch) -> Material:
    """Grass, soil, fallen leaves or snow."""
    style, rng = stretch.style, stretch.rng
    if style.snow and rng.random() < 0.8:
        return Material(Surface.GROUND, Label.TERRAIN, (0.9, 0.92, 0.95), Texture.SNOW, float(rng.uniform(6, 12)))
    kind = rng.random()
    if kind < 0.2:
        return Material(Surface.GROUND, Label.TERRAIN, _muted(style.grass), Texture.SOIL, float(rng.uniform(3, 10)))
    if kind < (0.5 if style.season in (Season.AUTUMN, Season.WINTER) else 0.24):
        return Material(Surface.GROUND, Label.TERRAIN, style.grass, Texture.LITTER, float(rng.uniform(2, 4)))
    return Material(Surface.GROUND, Label.TERRAIN, style.grass, Texture.GRASS, float(rng.uniform(3, 8)))


def _sealed(stretch: Stretch, tone: float) -> Material:
    """The surface of a yard or car park: often the road's own."""
    rng = stretch.rng
    if rng.random() < 0.5:
        return Material(Surface.ASPHALT, Label.ROAD, _grey(tone, rng), stretch.style.road, stretch.style.road_tile_m)
    textures = (Texture.ASPHALT, Texture.ASPHALT_PATCHED, Texture.CONCRETE, Texture.PAVING, Texture.GRAVEL)
    shade = float(np.clip(tone * np.exp(rng.normal(0, 0.5)), 0.03, 0.5))
    texture = textures[int(rng.integers(len(textures)))]
    return Material(Surface.ASPHALT, Label.ROAD, _grey(shade, rng), texture, float(rng.uniform(3, 9)))


def _sidewalk(stretch: Stretch, sign: int, ground: Material, road: Material) -> None:
    style, rng = stretch.style, stretch.rng
    side, edge = stretch.side(sign)
    paved = Material(
        Surface.PAVING,
        Label.SIDEWALK,
        _grey(float(np.clip(style.asphalt * rng.uniform(0.7, 3.0), 0.05, 0.55)), rng),
        [Texture.PAVING, Texture.ASPHALT, Texture.COBBLES, Texture.CONCRETE][
            int(rng.choice(4, p=[0.45, 0.3, 0.15, 0.1]))
        ],
        float(rng.uniform(1.2, 4.0)),
    )
    at, lift = edge + side.parking_m, style.kerb_m
    stone = Material(Surface.PAVING, Label.SIDEWALK, _grey(float(rng.uniform(0.12, 0.45)), rng), Texture.PLAIN)
    lane = Material(
        Surface.PAVING,
        Label.ROAD,
        _grey(road.colour[1] * rng.uniform(0.8, 1.4), rng),
        Texture.COBBLES if rng.random() < 0.3 else road.texture,
        4.0,
    )
    for start, stop in stretch.spans:
        if side.parking_m > 0:
            stretch.strip(sign * edge, sign * at, 0.0, lane, start, stop)
        stretch.strip(sign * at, sign * (at + 0.02), (0.0, lift), stone, start, stop)
        stretch.strip(sign * (at + 0.02), sign * (at + 0.16), lift, stone, start, stop)
        stretch.strip(sign * (at + 0.16), sign * (edge + side.land_m), lift, paved, start, stop)
        if side.verge_m > 0.3:
            stretch.strip(sign * (at + 0.3), sign * (edge + side.walk_start_m), lift + 0.03, ground, start, stop)


def _verge(stretch: Stretch, sign: int) -> None:
    """Gravel, dirt, leaves or ploughed snow hides the straight edge of the asphalt."""
    style, rng = stretch.style, stretch.rng
    _, edge = stretch.side(sign)
    colour: Colour = (0.85, 0.88, 0.92) if style.snow else _muted(style.grass)
    texture = Texture.SNOW if style.snow else (Texture.SOIL, Texture.GRAVEL, Texture.LITTER)[int(rng.integers(3))]
    dirt = Material(Surface.GROUND, Label.TERRAIN, colour, texture, float(rng.uniform(2, 6)))
    inner, outer = edge - rng.uniform(0, 0.4), edge + rng.uniform(0.3, 1.5)
    for start, stop in stretch.spans:
        stretch.strip(sign * inner, sign * outer, (0.012, 0.03), dirt, start, stop)


def _land_surface(stretch: Stretch, sign: int, material: Material) -> None:
    side, edge = stretch.side(sign)
    near = [-0.3, 0.9, 1.5, 2.0, 2.8, 3.4, 4.2] if side.ditch_m > 0 else [-0.3, 1.0, 3.0]
    reach = np.array([*near, 6.0, 10.0, 16.0, 25.0, 38.0, 52.0, 70.0, LAND_REACH_M])
    for start, stop in stretch.spans:
        s = np.linspace(start, stop, max(2, int((stop - start) / STATION_STEP_M) + 1))
        along, outwards = np.meshgrid(s, reach, indexing="ij")
        z = _land_height(stretch, sign, along, outwards)
        stretch.grid(s, sign * (edge + side.land_m + reach), z, material)


def _land_height(
    stretch: Stretch, sign: int, along: npt.NDArray[np.float64], outwards: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    z = stretch.ground_m(sign, along, outwards) - 0.02
    if stretch.land[sign] in (Land.LOT, Land.OPEN):
        return z
    return np.asarray(z + 0.06 * np.sin(along * 1.1 + outwards * 0.7) * (outwards > 2), np.float64)


def _side_road(stretch: Stretch, tone: float) -> None:
    """A road on both sides, with the edges of what it cuts through."""
    rng, half, at = stretch.rng, stretch.style.crossing_half_m, stretch.crossing_m
    texture = stretch.style.road if rng.random() < 0.6 else (Texture.ASPHALT, Texture.GRAVEL)[int(rng.random() < 0.15)]
    colour = _grey(tone * float(np.exp(rng.normal(0, 0.2))), rng)
    road = Material(Surface.ASPHALT, Label.ROAD, colour, texture, stretch.style.road_tile_m)
    for sign in (1, -1):
        side, edge = stretch.side(sign)
        reach = np.array([0.0, 1.0, 3.0, 6.0, 10.0, 16.0, 25.0, 38.0, 52.0, 70.0, LAND_REACH_M])
        s = at + np.array([-half - 0.02, -half, 0.0, half, half + 0.02])
        along, outwards = np.meshgrid(s, reach, indexing="ij")
        z = side_road_height(stretch, sign, along, outwards)
        # The outermost columns are the cut edges: as high as the land and the sidewalk.
        for column in (0, -1):
            z[column] = np.maximum(z[column], _land_height(stretch, sign, along, outwards - side.land_m)[column])
        stretch.grid(s, sign * (edge + reach), z, road)


def side_road_height(stretch: Stretch, sign: int, s: npt.ArrayLike, outwards: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Height of the side road at a distance outwards from the edge of the road: as the land, without its steps."""
    side, _ = stretch.side(sign)
    base = stretch.style.kerb_m if side.walk_m > 0 else -0.02
    return stretch.ground_m(sign, s, np.asarray(outwards) - side.land_m, ditch=False) - base + 0.003


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
    stone = Material(Surface.PAVING, Label.TERRAIN, _grey(0.3, rng))
    for start, stop in stretch.spans:
        stretch.strip(-inner, inner, style.kerb_m, grown, start, stop)
        for sign in (1, -1):
            stretch.strip(sign * inner, sign * (inner + 0.03), (style.kerb_m, 0.0), stone, start, stop)
    if style.kind is StreetKind.HIGHWAY:
        if style.lanes % 2:
            stretch.place_along(furniture.concrete_barrier, 1, stretch.start_m, stretch.stop_m, 0.0, style.kerb_m)
        else:
            for sign in (1, -1):
                stretch.place_along(
                    furniture.guard_rail, sign, stretch.start_m, stretch.stop_m, -sign * 0.3, style.kerb_m
                )
    elif half > 1.0:
        for s in np.arange(stretch.start_m + 3, stretch.stop_m, rng.uniform(7, 25)):
            if rng.random() < 0.7 and not stretch.crosses(float(s), float(s)):
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
    tar = Material(Surface.ASPHALT, Label.ROAD, _grey(float(rng.uniform(0.015, 0.04)), rng), Texture.ASPHALT, 2.0)
    if rng.random() < 0.35:
        # Seams between the lanes, and wheel tracks: darker where tyres polish, lighter where they wear.
        for lane in range(-style.oncoming_lanes, style.lanes):
            t = style.lane_centre_m(lane) + style.lane_m / 2
            stretch.strip(t - 0.03, t + 0.03, 0.0032, tar)
    if rng.random() < 0.35:
        track = Material(Surface.ASPHALT, Label.ROAD, _grey(tone * style.track, rng), style.road, style.road_tile_m)
        for lane in range(-style.oncoming_lanes, style.lanes):
            for aside in (-0.8, 0.8):
                t = style.lane_centre_m(lane) + aside
                stretch.strip(t - 0.28, t + 0.28, 0.0015, track)
    for _ in range(int(rng.poisson(1.0))):
        # Cracks across the road, sealed with tar.
        s = float(rng.uniform(stretch.start_m, stretch.stop_m - 4))
        across = np.linspace(low, high, 12)
        wander = s + np.clip(np.cumsum(rng.normal(0, 0.25, 12)), -3, 3)
        width = float(rng.uniform(0.03, 0.12))
        along = np.stack([wander, wander + width])
        points = np.concatenate(
            [stretch.path.position(along, across), (0.0036 + stretch.path.camber(along, across))[..., None]], axis=-1
        )
        stretch.parts.append(sheet(points, tar))
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
