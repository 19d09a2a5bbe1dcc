"""Draws the street of a seed: its cross-section, season and colours."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Colour, Texture
from radcam_depth_ros.simulation.settings.configuration import Season, StreetKind, WorldConfig
from radcam_depth_ros.simulation.settings.randomness import log_uniform, pick


class Land(IntEnum):
    """Kinds of land beside the road."""

    BLOCKS = 0
    HOUSES = 1
    FOREST = 2
    FIELD = 3
    HALLS = 4
    PARK = 5
    NOISE_WALL = 6
    LOT = 7
    OPEN = 8


@dataclass(frozen=True)
class Side:
    """One side of the road, distances in metres outwards from the road's edge.

    Attributes:
        parking_m: Width of a parking lane; 0 for none.
        verge_m: Width of a green strip behind it.
        walk_m: Width of the sidewalk; 0 for none.
        parked: Share of the parking lane that is taken.
        tree_spacing_m: Between trees on the verge; 0 for none.
        guard_rail: Whether a rail runs along the edge.
        bank_m: Height that the land beside rises to, or falls to where negative.
        ditch_m: Depth of the ditch along the edge; 0 for none.
    """

    parking_m: float
    verge_m: float
    walk_m: float
    parked: float
    tree_spacing_m: float
    guard_rail: bool
    bank_m: float
    ditch_m: float

    @property
    def walk_start_m(self) -> float:
        """Where the sidewalk begins."""
        return self.parking_m + self.verge_m

    @property
    def land_m(self) -> float:
        """Where the land begins."""
        return self.walk_start_m + self.walk_m


@dataclass(frozen=True)
class StreetStyle:
    """The street of a seed. Right-hand traffic: the own lanes are right of the centre line (t < 0).

    Attributes:
        kind: Kind of cross-section, never ANY, JUNCTION, TUNNEL or CONSTRUCTION.
        special: What is special about it: the kind that was asked for.
        season: Season, never ANY.
        lanes: Lanes in the own direction.
        oncoming_lanes: Lanes of the others.
        closed_lanes: Outermost own lanes that are closed.
        lane_m: Width of a lane.
        median_m: Width of what separates the directions; 0 for a painted line.
        shoulder_m: Asphalt beyond the outer line.
        left: The left side.
        right: The right side.
        kerb_m: Height of the sidewalk.
        speed_mps: Usual speed.
        askew_rad: The own vehicle's heading less the road's: it turns, or leaves a parking place, slowly.
        min_radius_m: Tightest curve.
        headway_m: Usual distance between vehicles in a lane.
        waiting: Whether all wait at a red light.
        large: Share of vans, trucks and buses in the traffic.
        people_per_100m: On each sidewalk.
        land: Probability of each `Land`, for a stretch of one side.
        crossings: Probability of a side road in a stretch.
        crossing_half_m: Half the width of side roads.
        setback_m: From the sidewalk to the houses.
        asphalt: Linear albedo of the road.
        road: Its texture.
        road_tile_m: Metres that a tile of it covers.
        track: Albedo of wheel tracks as a multiple of the road's.
        grass: Colour of the ground that grows.
        foliage: Colour of the leaves.
        twig: Colour of bare twigs.
        bare: Share of broadleaf trees without leaves.
        conifers: Share of conifers.
        snow: Whether the ground is white.
        has_wires: Whether wires run along the road.
        tunnel: Albedo of a tunnel's walls.
        yellow_lines: Whether the centre line is yellow.
        wetness: 0 dry to 1 wet.
    """

    kind: StreetKind
    special: StreetKind
    season: Season
    lanes: int
    oncoming_lanes: int
    closed_lanes: int
    lane_m: float
    median_m: float
    shoulder_m: float
    left: Side
    right: Side
    kerb_m: float
    speed_mps: float
    askew_rad: float
    min_radius_m: float
    headway_m: float
    waiting: bool
    large: float
    people_per_100m: float
    land: tuple[float, ...]
    crossings: float
    crossing_half_m: float
    setback_m: float
    asphalt: float
    road: Texture
    road_tile_m: float
    track: float
    grass: Colour
    foliage: Colour
    twig: Colour
    bare: float
    conifers: float
    snow: bool
    has_wires: bool
    tunnel: float
    yellow_lines: bool
    wetness: float

    @property
    def open_lanes(self) -> int:
        """Own lanes that can be driven on."""
        return self.lanes - self.closed_lanes

    @property
    def right_edge_m(self) -> float:
        """Distance of the asphalt's right edge from the centre line."""
        return self.median_m / 2 + self.lanes * self.lane_m + self.shoulder_m

    @property
    def left_edge_m(self) -> float:
        """Distance of the asphalt's left edge from the centre line."""
        return self.median_m / 2 + self.oncoming_lanes * self.lane_m + self.shoulder_m

    def lane_centre_m(self, lane: int) -> float:
        """Offset `t` of a lane: 0, 1, ... are the own ones from the centre line outwards, -1, -2, ... the others."""
        if lane >= 0:
            return -(self.median_m / 2 + (lane + 0.5) * self.lane_m)
        return self.median_m / 2 + (-lane - 0.5) * self.lane_m


@dataclass(frozen=True)
class _Usual:
    """What is usual for a kind of cross-section.

    Attributes:
        land: Weights of `Land`'s members, in its order.
        speed_mps: Speed, from and to.
        bank_m: Height of the land beside the road, from and to.
        min_radius_m: Tightest curve.
        jam: Share of the seeds in a queue of vehicles.
        askew: Share of the seeds in which the own vehicle turns or leaves a parking place.
        people_per_100m: On each sidewalk.
        crossings: Probability of a side road in a stretch.
        wires: Share of the seeds with wires along the road.
    """

    land: tuple[float, ...]
    speed_mps: tuple[float, float]
    bank_m: tuple[float, float] = (0.0, 0.0)
    min_radius_m: float = 110.0
    jam: float = 0.15
    askew: float = 0.07
    people_per_100m: float = 0.1
    crossings: float = 0.03
    wires: float = 0.03


_USUAL = {
    StreetKind.TOWN: _Usual(
        (0.72, 0.04, 0.02, 0.0, 0.06, 0.07, 0.0, 0.05, 0.04), (3.0, 13.0), people_per_100m=5.0, crossings=0.2
    ),
    StreetKind.RESIDENTIAL: _Usual(
        (0.08, 0.62, 0.06, 0.04, 0.02, 0.11, 0.0, 0.04, 0.03),
        (3.0, 9.0),
        (-0.7, 1.2),
        people_per_100m=2.0,
        crossings=0.25,
        wires=0.15,
    ),
    StreetKind.ARTERIAL: _Usual(
        (0.14, 0.09, 0.24, 0.08, 0.20, 0.11, 0.03, 0.06, 0.05),
        (6.0, 19.0),
        (-1.0, 1.5),
        min_radius_m=160.0,
        people_per_100m=1.2,
        crossings=0.15,
    ),
    StreetKind.RURAL: _Usual(
        (0.0, 0.10, 0.32, 0.46, 0.03, 0.05, 0.0, 0.01, 0.03),
        (12.0, 27.0),
        (-3.0, 4.0),
        jam=0.04,
        askew=0.03,
        crossings=0.1,
        wires=0.3,
    ),
    StreetKind.HIGHWAY: _Usual(
        (0.0, 0.03, 0.33, 0.33, 0.08, 0.05, 0.14, 0.02, 0.02), (18.0, 34.0), (-4.0, 5.0), 450.0, askew=0.0
    ),
    StreetKind.CAR_PARK: _Usual(
        (0.0, 0.0, 0.0, 0.0, 0.06, 0.0, 0.0, 0.7, 0.24),
        (0.5, 4.0),
        jam=0.0,
        askew=0.4,
        people_per_100m=2.0,
        crossings=0.0,
    ),
}
# How common each kind is where any is asked for.
_COMMON = {
    StreetKind.TOWN: 0.17,
    **dict.fromkeys((StreetKind.RESIDENTIAL, StreetKind.ARTERIAL, StreetKind.RURAL), 0.16),
    **dict.fromkeys((StreetKind.HIGHWAY, StreetKind.JUNCTION), 0.10),
    StreetKind.CAR_PARK: 0.06,
    StreetKind.TUNNEL: 0.03,
    StreetKind.CONSTRUCTION: 0.06,
}
# The cross-sections on which each special kind is found.
_SECTIONS = {
    StreetKind.JUNCTION: (StreetKind.TOWN, StreetKind.ARTERIAL),
    StreetKind.TUNNEL: (StreetKind.TOWN, StreetKind.ARTERIAL, StreetKind.HIGHWAY),
    StreetKind.CONSTRUCTION: tuple(kind for kind in _USUAL if kind is not StreetKind.CAR_PARK),
}


def draw_style(rng: np.random.Generator, config: WorldConfig) -> StreetStyle:
    """Draws the street of a seed."""
    special, kind, season = _draw_kinds(rng, config)
    usual, works, junction = _USUAL[kind], special is StreetKind.CONSTRUCTION, special is StreetKind.JUNCTION
    is_highway = kind is StreetKind.HIGHWAY
    # Albedo from 0.03 (fresh asphalt) to 0.4 (concrete), uniform in its logarithm, so that brightness does not
    # identify the road.
    asphalt = log_uniform(rng, 0.03, 0.4)
    grass, foliage, bare = _growth(rng, season)
    lanes, oncoming, lane_m, median = _lanes(rng, kind)
    jam, waiting, speed, askew = _draw_pace(rng, usual, works, junction)
    closed_lanes = int(works and lanes > 1 and rng.random() < 0.7)
    wide, narrow, other = rng.uniform(1.5, 3.2), rng.uniform(0.0, 1.2), rng.uniform(0.2, 0.6)
    land = np.array(usual.land)
    return StreetStyle(
        kind=kind,
        special=special,
        season=season,
        lanes=lanes,
        oncoming_lanes=oncoming,
        closed_lanes=closed_lanes,
        lane_m=lane_m,
        median_m=median,
        shoulder_m=wide if is_highway else narrow if kind is StreetKind.RURAL else other,
        left=_side(rng, kind, config.parked, flat=junction),
        right=_side(rng, kind, config.parked, flat=junction),
        kerb_m=rng.uniform(0.04, 0.16),
        speed_mps=0.0 if waiting else speed * config.speed,
        askew_rad=askew,
        min_radius_m=usual.min_radius_m,
        headway_m=log_uniform(rng, 14, 220) * (1.5 if is_highway else 1.0) * (0.12 if jam or waiting else 1.0),
        waiting=waiting,
        large=rng.uniform(0.03, 0.45 if kind in (StreetKind.HIGHWAY, StreetKind.ARTERIAL) else 0.3),
        people_per_100m=usual.people_per_100m * rng.uniform(0.2, 2.0),
        land=tuple((land / land.sum()).tolist()),
        crossings=1.0 if junction else usual.crossings,
        crossing_half_m=rng.uniform(5.0, 11.0) if junction else rng.uniform(2.4, 4.2),
        setback_m=rng.uniform(0.0, 3.0) if kind is StreetKind.TOWN else rng.uniform(3.0, 12.0),
        asphalt=asphalt,
        road=_road(rng, kind),
        road_tile_m=rng.uniform(3, 11),
        track=float(np.exp(rng.normal(-0.05, 0.25))),
        grass=grass,
        foliage=foliage,
        twig=_jitter(rng, (0.07, 0.055, 0.045), 0.4),
        bare=bare,
        conifers=pick(rng, (0.0, 0.15, 0.5)),
        snow=season is Season.SNOW,
        has_wires=rng.random() < max(usual.wires, config.wires),
        tunnel=rng.uniform(0.12, 0.5),
        yellow_lines=rng.random() < (0.6 if works else 0.08),
        wetness=rng.uniform(0.3, 1.0) if rng.random() < 0.25 else 0.0,
    )


def _draw_kinds(rng: np.random.Generator, config: WorldConfig) -> tuple[StreetKind, StreetKind, Season]:
    """What is special about the street, its cross-section, and the season."""
    special, season = config.street, config.season
    if special is StreetKind.ANY:
        special = pick(rng, list(_COMMON), list(_COMMON.values()))
    kind = pick(rng, _SECTIONS.get(special, (special,)))
    if season is Season.ANY:
        season = pick(rng, (Season.SUMMER, Season.AUTUMN, Season.WINTER, Season.SNOW), (0.38, 0.17, 0.27, 0.18))
    return special, kind, season


def _draw_pace(rng: np.random.Generator, usual: _Usual, works: bool, junction: bool) -> tuple[bool, bool, float, float]:
    """Whether vehicles queue, slow and close together; whether they wait; their speed; the own heading's offset."""
    jam = rng.random() < usual.jam
    waiting = junction and rng.random() < 0.45
    speed = rng.uniform(0.3, 4.0) if jam else rng.uniform(*usual.speed_mps) * (0.6 if works else 1.0)
    askew = 0.0
    if rng.random() < usual.askew:
        askew, speed = rng.uniform(-1.3, 1.3), min(speed, rng.uniform(0.5, 2.0))
    return jam, waiting, speed, askew


def _road(rng: np.random.Generator, kind: StreetKind) -> Texture:
    shares = {
        Texture.ASPHALT: 0.42,
        Texture.ASPHALT_PATCHED: 0.22,
        Texture.ASPHALT_WORN: 0.18,
        Texture.CONCRETE: 0.06,
        Texture.COBBLES: 0.07 if kind in (StreetKind.TOWN, StreetKind.RESIDENTIAL, StreetKind.CAR_PARK) else 0.0,
        Texture.PAVING: 0.04 if kind in (StreetKind.RESIDENTIAL, StreetKind.CAR_PARK) else 0.0,
        Texture.GRAVEL: 0.05 if kind in (StreetKind.RURAL, StreetKind.CAR_PARK) else 0.0,
    }
    return pick(rng, list(shares), list(shares.values()))


def _jitter(rng: np.random.Generator, base: Colour, amount: float) -> Colour:
    r, g, b = np.array(base) * np.exp(rng.normal(0, amount / 2)) * (1 + amount * rng.uniform(-0.3, 0.3, 3))
    return float(r), float(g), float(b)


def _growth(rng: np.random.Generator, season: Season) -> tuple[Colour, Colour, float]:
    """Colour of the ground, of the leaves, and the share of bare trees."""
    if season is Season.SUMMER:
        return _jitter(rng, (0.13, 0.19, 0.05), 0.5), _jitter(rng, (0.10, 0.17, 0.04), 0.6), 0.03
    if season is Season.AUTUMN:
        leaves = pick(rng, [(0.30, 0.18, 0.04), (0.25, 0.08, 0.03), (0.16, 0.16, 0.05)])
        return _jitter(rng, (0.17, 0.17, 0.06), 0.5), _jitter(rng, leaves, 0.5), rng.uniform(0.2, 0.5)
    return _jitter(rng, (0.16, 0.15, 0.08), 0.5), _jitter(rng, (0.045, 0.065, 0.03), 0.6), rng.uniform(0.8, 1.0)


def _lanes(rng: np.random.Generator, kind: StreetKind) -> tuple[int, int, float, float]:
    """Own lanes, oncoming lanes, width of a lane, width of the median."""
    if kind is StreetKind.HIGHWAY:
        lanes = int(rng.integers(2, 5))
        return lanes, lanes, rng.uniform(3.4, 3.8), rng.uniform(1.6, 5.0)
    if kind is StreetKind.ARTERIAL:
        lanes = int(rng.integers(1, 4))
        median = rng.uniform(1.5, 5.0) if lanes > 1 and rng.random() < 0.4 else 0.0
        return lanes, max(1, lanes - int(rng.random() < 0.2)), rng.uniform(3.0, 3.6), median
    if kind is StreetKind.RURAL:
        return 1, 1, rng.uniform(2.3, 3.6), 0.0
    if kind is StreetKind.CAR_PARK:
        return 1, 1, rng.uniform(2.6, 4.0), 0.0
    if kind is StreetKind.TOWN:
        lanes = pick(rng, (1, 2), (0.65, 0.35))
        return lanes, lanes, rng.uniform(2.8, 3.5), 0.0
    return 1, 1, rng.uniform(2.5, 3.2), 0.0


def _side(rng: np.random.Generator, kind: StreetKind, parked: float, flat: bool) -> Side:
    town = kind in (StreetKind.TOWN, StreetKind.RESIDENTIAL)
    paved = (town and rng.random() < 0.93) or (kind is StreetKind.ARTERIAL and rng.random() < 0.75)
    parking = rng.uniform(2.0, 2.4) if (town and rng.random() < 0.7) or (paved and rng.random() < 0.2) else 0.0
    verge = rng.uniform(0.8, 4.0) if (paved and rng.random() < 0.4) else 0.0
    outside = kind in (StreetKind.RURAL, StreetKind.HIGHWAY)
    return Side(
        parking_m=parking,
        verge_m=verge,
        walk_m=rng.uniform(1.5, 4.5) if paved else 0.0,
        parked=min(1.0, parked * rng.uniform(0.25, 0.95)),
        tree_spacing_m=rng.uniform(7, 22) if rng.random() < (0.5 if paved else 0.3) else 0.0,
        guard_rail=bool(outside and rng.random() < (0.75 if kind is StreetKind.HIGHWAY else 0.25)),
        bank_m=0.0 if flat else rng.uniform(*_USUAL[kind].bank_m),
        ditch_m=rng.uniform(0.2, 1.2) if outside and rng.random() < 0.5 else 0.0,
    )
