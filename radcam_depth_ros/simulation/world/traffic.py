"""Everything that moves besides the own vehicle: vehicles in lanes, people and bicycles along the road."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.simulation.objects.animals import AnimalKind
from radcam_depth_ros.simulation.objects.library import Library
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.objects.people import STRIDE_M
from radcam_depth_ros.simulation.settings.configuration import StreetKind, WorldConfig
from radcam_depth_ros.simulation.settings.style import StreetStyle
from radcam_depth_ros.simulation.world.ego import EgoDrive
from radcam_depth_ros.simulation.world.path import DoubleArray, Path
from radcam_depth_ros.simulation.world.relief import Relief

BEHIND_M = 70.0
"""Movers are kept this far behind the own vehicle"""

AHEAD_M = 300.0
"""and this far ahead."""

_PEOPLE_AHEAD_M = 150.0
_DERIVATIVE_S = 1e-2
# Nothing crosses the road this near to the own vehicle's footprint, along the road and across it.
_CLEAR_ALONG_M, _CLEAR_ACROSS_M = 7.0, 3.0


@dataclass(frozen=True)
class Mover:
    """Something that moves along the road or across it.

    Attributes:
        poses: Meshes of one cycle of movement; one for what does not change its shape.
        cycle_m: Metres in which all poses are gone through.
        s: Where it is along the road at a time, metres.
        t: Its offset from the centre line at a time.
        height_m: Height that it stands on.
        yaw: Its heading less the road's, radians.
    """

    poses: tuple[Mesh, ...]
    cycle_m: float
    s: Callable[[float], float]
    t: Callable[[float], float]
    height_m: float
    yaw: float


class Traffic:
    """All movers of a drive."""

    def __init__(
        self,
        rng: np.random.Generator,
        config: WorldConfig,
        style: StreetStyle,
        path: Path,
        relief: Relief,
        library: Library,
        ego: EgoDrive,
        duration_s: float,
        crossings_m: Sequence[float],
    ) -> None:
        self._path, self._relief = path, relief
        self._ego, self._library, self._style = ego, library, style
        self._duration_s, self._crossings_m = duration_s, crossings_m
        # Who follows closely keeps the distance.
        self._near = bool(rng.random() < 0.35)
        depth = float(rng.uniform(0, 0.12 if self._near else 0.35)) * float(not style.waiting)
        self._breath = (depth, float(rng.uniform(14, 45)), float(rng.uniform(0, 6.28)))
        self._movers: list[Mover] = []
        if config.traffic > 0:
            for lane in range(-style.oncoming_lanes, style.open_lanes):
                if self._stands_in(lane):
                    continue
                self._fill_lane(rng, lane, style.headway_m / config.traffic)
            if style.special is StreetKind.JUNCTION:
                for crossing_m in crossings_m:
                    self._fill_crossing(rng, crossing_m, config.traffic)
        if config.people > 0:
            self._fill_sidewalks(rng, config.people)
            self._fill_road(rng, config.people)

    def at(self, time: float) -> Iterator[tuple[Mesh, DoubleArray]]:
        """The movers near the own vehicle at a time: meshes in world coordinates and velocities (3,), m/s."""
        here = float(self._ego.s(time))
        for mover in self._movers:
            s = mover.s(time)
            if not here - BEHIND_M < s < here + (AHEAD_M if mover.cycle_m == 1.0 else _PEOPLE_AHEAD_M):
                continue
            t = mover.t(time)
            x, y = self._path.position(s, t)
            times = (time - _DERIVATIVE_S, time + _DERIVATIVE_S)
            along, across = np.array([mover.s(at) for at in times]), np.array([mover.t(at) for at in times])
            step = np.diff(self._path.position(along, across), axis=0)[0] / (2 * _DERIVATIVE_S)
            travelled = s + (t if abs(np.sin(mover.yaw)) > 0.5 else 0.0)
            pose = mover.poses[int(travelled / mover.cycle_m * len(mover.poses)) % len(mover.poses)]
            yaw = float(self._path.heading(s)) + mover.yaw
            climb = float(self._relief.slope(float(x), float(y)) @ step)
            climb += float(np.diff(self._path.camber(along, across))[0]) / (2 * _DERIVATIVE_S)
            placed = self._path.tilted(pose.moved((float(x), float(y), mover.height_m), yaw), s, t)
            yield self._relief.lifted(placed), np.array([step[0], step[1], climb])

    def _fill_lane(self, rng: np.random.Generator, lane: int, headway_m: float) -> None:
        style = self._style
        own, oncoming = lane == self._ego.lane, lane < 0
        # What does not move at all is in one place for the whole drive, as is what the own vehicle follows.
        speed = style.speed_mps * float(rng.uniform(0.75, 1.3)) * (-1 if oncoming else 1)
        if own:
            low, high = -BEHIND_M, AHEAD_M
        else:
            low, high = self._needed(speed)
        # Somebody in front of somebody behind: nobody overlaps the own vehicle.
        place = low + float(rng.uniform(0, headway_m))
        while place < high:
            vehicle = self._library.draw_vehicle(rng, style.large)
            gap = float(rng.uniform(1.2, 2.5)) + float(rng.gamma(1.3, headway_m / 1.3))
            half = vehicle.length_m / 2
            place += half
            if own and place + half > -5.0 and place - half < 6.0:
                ahead = float(rng.uniform(5.5, 14.0)) if self._near else 9.0 + float(rng.gamma(1.2, headway_m / 2))
                place = ahead + half
            if not (style.waiting and self._blocks_crossing(place, half)):
                self._movers.append(
                    Mover(
                        poses=(vehicle.mesh,),
                        cycle_m=1.0,
                        s=self._following(place) if own else _steady(place, speed),
                        t=_steady(style.lane_centre_m(lane) + float(rng.normal(0, 0.18)), 0.0),
                        height_m=0.0,
                        yaw=(np.pi if oncoming else 0.0) + float(rng.normal(0, 0.012)),
                    )
                )
            place += half + gap

    def _stands_in(self, lane: int) -> bool:
        """Whether the own vehicle, standing askew, reaches into another lane: nobody drives there then."""
        away = abs(self._style.lane_centre_m(lane) - self._style.lane_centre_m(self._ego.lane))
        return bool(self._style.askew_rad and 0 < away < 5.0)

    def _blocks_crossing(self, place: float, half: float) -> bool:
        clear = self._style.crossing_half_m + 5.0 + half
        return any(abs(place - crossing_m) < clear for crossing_m in self._crossings_m)

    def _fill_crossing(self, rng: np.random.Generator, crossing_m: float, traffic: float) -> None:
        """Vehicles on the side road: they cross while the own direction waits, else they pass now and then."""
        style = self._style
        for sign in (1, -1):
            speed = sign * float(rng.uniform(3, 12))
            place = -140.0 - abs(speed) * self._duration_s
            while place < 140.0:
                vehicle = self._library.draw_vehicle(rng, style.large)
                place += vehicle.length_m + 3.0 + float(rng.gamma(1.2, (14.0 if style.waiting else 70.0) / traffic))
                lane = (
                    sign * style.crossing_half_m * float(rng.choice([0.3, 0.65]) if style.crossing_half_m > 6 else 0.5)
                )
                across = _steady(sign * place, speed)
                if self._is_clear(crossing_m + lane, across, vehicle.length_m / 2):
                    self._movers.append(
                        Mover((vehicle.mesh,), 1.0, _steady(crossing_m + lane, 0.0), across, 0.004, sign * np.pi / 2)
                    )

    def _is_clear(self, s: float, across: Callable[[float], float], half: float = 0.0) -> bool:
        """Whether something that crosses the road at `s` stays clear of the own vehicle."""
        times = np.arange(0.0, self._duration_s + 0.2, 0.2)
        near = times[np.abs(self._ego.s(times) - s) < _CLEAR_ALONG_M]
        own_t = self._style.lane_centre_m(self._ego.lane)
        return all(abs(across(float(time)) - own_t) > _CLEAR_ACROSS_M + half for time in near)

    def _needed(self, speed: float) -> tuple[float, float]:
        """Places at time 0 from which something at a speed comes into view during the drive."""
        times = np.linspace(0, self._duration_s, 200)
        relative = self._ego.s(times) - speed * times
        return float(relative.min()) - BEHIND_M, float(relative.max()) + AHEAD_M

    def _following(self, gap: float) -> Callable[[float], float]:
        # Gaps in the own lane stretch and shrink together, so that nobody runs into anybody.
        depth, period, phase = self._breath
        ego = self._ego

        def s(time: float) -> float:
            return float(ego.s(time)) + gap * (1 + depth * float(np.sin(2 * np.pi * time / period + phase)))

        return s

    def _fill_sidewalks(self, rng: np.random.Generator, people: float) -> None:
        style = self._style
        for sign, side, edge in ((1, style.left, style.left_edge_m), (-1, style.right, style.right_edge_m)):
            lot = style.kind is StreetKind.CAR_PARK
            if side.walk_m <= 0 and not lot:
                continue
            rate = style.people_per_100m * people / 100
            for forwards in (True, False):
                low, high = self._needed(1.35 if forwards else -1.35)
                for _ in range(int(rng.poisson(rate / 2 * (high - low)))):
                    speed = float(rng.uniform(0.9, 1.6)) * (1 if forwards else -1)
                    first = side.walk_start_m + float(rng.uniform(0.5, 9.0 if lot else max(side.walk_m - 0.4, 0.6)))
                    place = float(rng.uniform(low, high))
                    # Two in seven are not alone.
                    for _ in range(int(rng.choice([1, 2, 3, 4], p=[0.72, 0.18, 0.06, 0.04]))):
                        out = first + float(rng.normal(0, 0.35))
                        self._movers.append(
                            Mover(
                                self._library.draw_walker(rng).poses,
                                STRIDE_M,
                                _steady(place, speed),
                                _steady(sign * (edge + max(out, 0.3)), 0.0),
                                style.kerb_m if side.walk_m > 0 else 0.0,
                                0.0 if forwards else np.pi,
                            )
                        )
                        place += float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.5, 1.0))
            if rng.random() < 0.7 * people and not lot and not style.askew_rad:
                self._fill_cyclists(rng, sign, edge)

    def _fill_road(self, rng: np.random.Generator, people: float) -> None:
        """People who cross the road, here and there an animal."""
        style = self._style
        reach = float(self._ego.s(self._duration_s))
        rate = min(style.people_per_100m * people, 8.0) / 100 * 0.5
        for _ in range(int(rng.poisson(rate * (reach + 120)))):
            poses = self._library.draw_walker(rng).poses
            self._cross(rng, poses, STRIDE_M, float(rng.uniform(0.8, 1.9)), reach)
        wild = 0.25 if style.kind is StreetKind.RURAL else 0.06
        if style.kind is not StreetKind.HIGHWAY and rng.random() < wild * people:
            kinds = list(AnimalKind) if style.kind is StreetKind.RURAL else [AnimalKind.DOG]
            animal = self._library.animals[kinds[int(rng.integers(len(kinds)))]]
            self._cross(rng, (animal,), 1.0, float(rng.uniform(0.0, 3.0)), reach)

    def _cross(
        self, rng: np.random.Generator, poses: tuple[Mesh, ...], cycle_m: float, speed: float, reach: float
    ) -> None:
        style, sign = self._style, float(rng.choice([-1.0, 1.0]))
        place = float(rng.uniform(5, reach + 120))
        # In the middle of the road some time before the own vehicle comes by.
        middle = float(np.interp(place - rng.uniform(8, 60), *self._arrivals()))
        low, high = -style.right_edge_m, style.left_edge_m

        def across(time: float) -> float:
            way = sign * speed * (time - middle)
            return float(np.clip(way, low + 0.3, high - 0.3))

        if self._is_clear(place, across):
            self._movers.append(Mover(poses, cycle_m, _steady(place, 0.0), across, 0.0, sign * np.pi / 2))

    def _arrivals(self) -> tuple[DoubleArray, DoubleArray]:
        times = np.linspace(0, self._duration_s, 200)
        return np.asarray(self._ego.s(times), np.float64), times

    def _fill_cyclists(self, rng: np.random.Generator, sign: int, edge: float) -> None:
        speed = float(rng.uniform(3, 6.5)) * -sign
        low, high = self._needed(speed)
        for place in np.arange(low, high, float(rng.uniform(60, 250))):
            mesh = self._library.cyclists[int(rng.integers(len(self._library.cyclists)))]
            start, t = float(place + rng.uniform(0, 30)), sign * (edge - 0.35)
            self._movers.append(
                Mover((mesh,), 1.0, _steady(start, speed), _steady(t, 0.0), 0.0, np.pi if sign > 0 else 0.0)
            )


def _steady(place: float, speed: float) -> Callable[[float], float]:
    return lambda time: place + speed * time
