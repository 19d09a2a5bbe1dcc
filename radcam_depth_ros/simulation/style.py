"""What a seed decides once of the street: its cross-section, its season, its colours."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from radcam_depth_ros.simulation.configuration import Season, StreetKind, WorldConfig

Colour = tuple[float, float, float]


class Land(IntEnum):
    """What lies beside the road for some length."""

    BLOCKS = 0
    HOUSES = 1
    FOREST = 2
    FIELD = 3
    HALLS = 4
    PARK = 5
    NOISE_WALL = 6


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
    """

    parking_m: float
    verge_m: float
    walk_m: float
    parked: float
    tree_spacing_m: float
    guard_rail: bool
    bank_m: float

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
        kind: Kind of street, never ANY.
        season: Season, never ANY.
        lanes: Lanes in the own direction.
        oncoming_lanes: Lanes of the others.
        lane_m: Width of a lane.
        median_m: Width of what separates the directions; 0 for a painted line.
        shoulder_m: Asphalt beyond the outer line.
        left: The left side.
        right: The right side.
        kerb_m: Height of the sidewalk.
        speed_mps: Usual speed.
        min_radius_m: Tightest curve.
        headway_m: Usual distance between vehicles in a lane.
        people_per_100m: On each sidewalk.
        land: Probability of each `Land`, for a stretch of one side.
        crossings: Probability of a side road in a stretch.
        setback_m: From the sidewalk to the houses.
        asphalt: Linear albedo of the road.
        grass: Colour of the ground that grows.
        foliage: Colour of the leaves.
        twig: Colour of bare twigs.
        bare: Share of broadleaf trees without leaves.
        conifers: Share of conifers.
        snow: Whether the ground is white.
        yellow_lines: Whether the centre line is yellow.
        wetness: 0 dry to 1 wet.
    """

    kind: StreetKind
    season: Season
    lanes: int
    oncoming_lanes: int
    lane_m: float
    median_m: float
    shoulder_m: float
    left: Side
    right: Side
    kerb_m: float
    speed_mps: float
    min_radius_m: float
    headway_m: float
    people_per_100m: float
    land: tuple[float, ...]
    crossings: float
    setback_m: float
    asphalt: float
    grass: Colour
    foliage: Colour
    twig: Colour
    bare: float
    conifers: float
    snow: bool
    yellow_lines: bool
    wetness: float

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


# Probabilities of Land's members, in its order.
_LAND: dict[StreetKind, tuple[float, ...]] = {
    StreetKind.TOWN: (0.80, 0.04, 0.02, 0.0, 0.06, 0.08, 0.0),
    StreetKind.RESIDENTIAL: (0.08, 0.70, 0.06, 0.02, 0.02, 0.12, 0.0),
    StreetKind.ARTERIAL: (0.16, 0.10, 0.30, 0.06, 0.22, 0.14, 0.02),
    StreetKind.RURAL: (0.0, 0.10, 0.34, 0.46, 0.03, 0.07, 0.0),
    StreetKind.HIGHWAY: (0.0, 0.03, 0.34, 0.34, 0.09, 0.05, 0.15),
}


def draw_style(rng: np.random.Generator, config: WorldConfig) -> StreetStyle:
    """Draws the street of a seed."""
    kind = config.street
    if kind is StreetKind.ANY:
        kinds = [StreetKind.TOWN, StreetKind.RESIDENTIAL, StreetKind.ARTERIAL, StreetKind.RURAL, StreetKind.HIGHWAY]
        kind = kinds[int(rng.choice(5, p=[0.25, 0.2, 0.25, 0.18, 0.12]))]
    season = config.season
    if season is Season.ANY:
        seasons = [Season.SUMMER, Season.AUTUMN, Season.WINTER, Season.SNOW]
        season = seasons[int(rng.choice(4, p=[0.45, 0.15, 0.2, 0.2]))]
    # Albedo from 0.04 (fresh asphalt) to 0.35 (concrete), even in its logarithm: no brightness belongs to the road.
    asphalt = float(np.exp(rng.uniform(np.log(0.035), np.log(0.35))))
    grass, foliage, bare = _growth(rng, season)
    lanes, oncoming, lane_m, median = _lanes(rng, kind)
    return StreetStyle(
        kind=kind,
        season=season,
        lanes=lanes,
        oncoming_lanes=oncoming,
        lane_m=lane_m,
        median_m=median,
        shoulder_m={
            StreetKind.HIGHWAY: float(rng.uniform(1.5, 3.2)),
            StreetKind.RURAL: float(rng.uniform(0.2, 1.2)),
        }.get(kind, float(rng.uniform(0.2, 0.6))),
        left=_side(rng, kind, config.parked),
        right=_side(rng, kind, config.parked),
        kerb_m=float(rng.uniform(0.06, 0.16)),
        speed_mps=_speed(rng, kind) * config.speed,
        min_radius_m={StreetKind.HIGHWAY: 450.0, StreetKind.RURAL: 160.0, StreetKind.ARTERIAL: 220.0}.get(kind, 140.0),
        headway_m=float(np.exp(rng.uniform(np.log(14), np.log(80)))) * (1.5 if kind is StreetKind.HIGHWAY else 1.0),
        people_per_100m={StreetKind.TOWN: 5.0, StreetKind.RESIDENTIAL: 2.0, StreetKind.ARTERIAL: 1.2}.get(kind, 0.1)
        * float(rng.uniform(0.2, 2.0)),
        land=_LAND[kind],
        crossings={StreetKind.TOWN: 0.2, StreetKind.RESIDENTIAL: 0.25, StreetKind.ARTERIAL: 0.15}.get(kind, 0.05),
        setback_m=float(rng.uniform(0.0, 3.0) if kind is StreetKind.TOWN else rng.uniform(3.0, 12.0)),
        asphalt=asphalt,
        grass=grass,
        foliage=foliage,
        twig=_jitter(rng, (0.07, 0.055, 0.045), 0.4),
        bare=bare,
        conifers=float(rng.choice([0.0, 0.15, 0.5])),
        snow=season is Season.SNOW,
        yellow_lines=bool(rng.random() < 0.15),
        wetness=float(rng.uniform(0.3, 1.0) if rng.random() < 0.25 else 0.0),
    )


def _jitter(rng: np.random.Generator, base: Colour, amount: float) -> Colour:
    r, g, b = np.array(base) * np.exp(rng.normal(0, amount / 2)) * (1 + amount * rng.uniform(-0.3, 0.3, 3))
    return float(r), float(g), float(b)


def _growth(rng: np.random.Generator, season: Season) -> tuple[Colour, Colour, float]:
    """Colour of the ground, of the leaves, and the share of bare trees."""
    if season is Season.SUMMER:
        return _jitter(rng, (0.13, 0.19, 0.05), 0.5), _jitter(rng, (0.10, 0.17, 0.04), 0.6), 0.03
    if season is Season.AUTUMN:
        leaves = [(0.30, 0.18, 0.04), (0.25, 0.08, 0.03), (0.16, 0.16, 0.05)][int(rng.integers(3))]
        return _jitter(rng, (0.17, 0.17, 0.06), 0.5), _jitter(rng, leaves, 0.5), float(rng.uniform(0.2, 0.5))
    return _jitter(rng, (0.16, 0.15, 0.08), 0.5), _jitter(rng, (0.045, 0.065, 0.03), 0.6), float(rng.uniform(0.8, 1.0))


def _lanes(rng: np.random.Generator, kind: StreetKind) -> tuple[int, int, float, float]:
    """Own lanes, oncoming lanes, width of a lane, width of the median."""
    if kind is StreetKind.HIGHWAY:
        lanes = int(rng.integers(2, 5))
        return lanes, lanes, float(rng.uniform(3.4, 3.8)), float(rng.uniform(1.6, 5.0))
    if kind is StreetKind.ARTERIAL:
        lanes = int(rng.integers(1, 4))
        median = float(rng.uniform(1.5, 5.0)) if lanes > 1 and rng.random() < 0.4 else 0.0
        return lanes, max(1, lanes - int(rng.random() < 0.2)), float(rng.uniform(3.0, 3.6)), median
    if kind is StreetKind.RURAL:
        return 1, 1, float(rng.uniform(2.6, 3.6)), 0.0
    if kind is StreetKind.TOWN:
        lanes = int(rng.choice([1, 2], p=[0.65, 0.35]))
        return lanes, lanes, float(rng.uniform(2.8, 3.5)), 0.0
    return 1, 1, float(rng.uniform(2.5, 3.2)), 0.0


def _speed(rng: np.random.Generator, kind: StreetKind) -> float:
    low, high = {
        StreetKind.TOWN: (3.0, 13.0),
        StreetKind.RESIDENTIAL: (3.0, 9.0),
        StreetKind.ARTERIAL: (6.0, 19.0),
        StreetKind.RURAL: (12.0, 27.0),
        StreetKind.HIGHWAY: (18.0, 34.0),
    }[kind]
    return float(rng.uniform(low, high))


def _side(rng: np.random.Generator, kind: StreetKind, parked: float) -> Side:
    town = kind in (StreetKind.TOWN, StreetKind.RESIDENTIAL)
    paved = town or (kind is StreetKind.ARTERIAL and rng.random() < 0.75)
    parking = float(rng.uniform(2.0, 2.4)) if (town and rng.random() < 0.7) or (paved and rng.random() < 0.2) else 0.0
    verge = float(rng.uniform(0.8, 4.0)) if (paved and rng.random() < 0.4) else 0.0
    bank = {StreetKind.RURAL: 2.5, StreetKind.HIGHWAY: 4.0, StreetKind.ARTERIAL: 1.0}.get(kind, 0.0)
    return Side(
        parking_m=parking,
        verge_m=verge,
        walk_m=float(rng.uniform(1.5, 4.5)) if paved else 0.0,
        parked=min(1.0, parked * float(rng.uniform(0.25, 0.95))),
        tree_spacing_m=float(rng.uniform(7, 22)) if rng.random() < (0.5 if paved else 0.3) else 0.0,
        guard_rail=bool(not paved and rng.random() < (0.75 if kind is StreetKind.HIGHWAY else 0.25)),
        bank_m=float(rng.uniform(-0.6, 1.0) * bank),
    )
