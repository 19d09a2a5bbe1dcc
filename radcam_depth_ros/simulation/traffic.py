"""Everything that moves besides the own vehicle: vehicles in lanes, people and bicycles along the road."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from radcam_depth_ros.simulation.configuration import StreetKind, WorldConfig
from radcam_depth_ros.simulation.ego import EgoDrive
from radcam_depth_ros.simulation.library import Library
from radcam_depth_ros.simulation.mesh import Mesh
from radcam_depth_ros.simulation.path import DoubleArray, Path
from radcam_depth_ros.simulation.people import STEP_M
from radcam_depth_ros.simulation.relief import Relief
from radcam_depth_ros.simulation.style import StreetStyle

BEHIND_M = 70.0
"""Movers are kept this far behind the own vehicle"""

AHEAD_M = 300.0
"""and this far ahead."""

_PEOPLE_AHEAD_M = 150.0
_DERIVATIVE_S = 1e-2


@dataclass(frozen=True)
class Mover:
    """Something that moves along the road.

    Attributes:
        poses: Meshes of one cycle of movement; one for what does not change its shape.
        cycle_m: Metres in which all poses are gone through.
        s: Where it is along the road at a time, metres.
        t: Its offset from the centre line.
        height_m: Height that it stands on.
        backwards: Whether it goes against the own direction.
    """

    poses: tuple[Mesh, ...]
    cycle_m: float
    s: Callable[[float], float]
    t: float
    height_m: float
    backwards: bool


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
    ) -> None:
        self._path, self._relief = path, relief
        self._ego, self._library, self._style = ego, library, style
        self._duration_s = duration_s
        self._breath = (float(rng.uniform(0, 0.35)), float(rng.uniform(14, 45)), float(rng.uniform(0, 6.28)))
        self._movers: list[Mover] = []
        if config.traffic > 0:
            for lane in range(-style.oncoming_lanes, style.lanes):
                self._fill_lane(rng, lane, style.headway_m / config.traffic)
        if config.people > 0:
            self._fill_sidewalks(rng, config.people)

    def at(self, time: float) -> Iterator[tuple[Mesh, DoubleArray]]:
        """The movers near the own vehicle at a time: meshes in world coordinates and velocities (3,), m/s."""
        here = float(self._ego.s(time))
        for mover in self._movers:
            s = mover.s(time)
            if not here - BEHIND_M < s < here + (AHEAD_M if mover.cycle_m == 1.0 else _PEOPLE_AHEAD_M):
                continue
            x, y = self._path.position(s, mover.t)
            around = np.array([mover.s(time - _DERIVATIVE_S), mover.s(time + _DERIVATIVE_S)])
            step = np.diff(self._path.position(around, mover.t), axis=0)[0] / (2 * _DERIVATIVE_S)
            pose = mover.poses[int(s / mover.cycle_m * len(mover.poses)) % len(mover.poses)]
            yaw = float(self._path.heading(s)) + (np.pi if mover.backwards else 0.0)
            climb = float(self._relief.slope(float(x), float(y)) @ step)
            mesh = self._relief.lifted(pose.moved((float(x), float(y), mover.height_m), yaw))
            yield mesh, np.array([step[0], step[1], climb])

    def _fill_lane(self, rng: np.random.Generator, lane: int, headway_m: float) -> None:
        style = self._style
        large = {StreetKind.HIGHWAY: 0.3, StreetKind.ARTERIAL: 0.25, StreetKind.RURAL: 0.2}.get(style.kind, 0.15)
        own, oncoming = lane == self._ego.lane, lane < 0
        speed = style.speed_mps * float(rng.uniform(0.75, 1.3)) * (-1 if oncoming else 1)
        if own:
            low, high = -BEHIND_M, AHEAD_M
        else:
            low, high = self._needed(speed)
        # Somebody in front of somebody behind: nobody overlaps the own vehicle.
        place = low + float(rng.uniform(0, headway_m))
        while place < high:
            vehicle = self._library.draw_vehicle(rng, large)
            gap = 2.5 + float(rng.gamma(1.3, headway_m / 1.3))
            place += vehicle.length_m / 2
            clear = 9.0 if own else 0.0
            if (own and -clear < place - vehicle.length_m / 2 < clear) or (
                own and -clear < place + vehicle.length_m / 2 < clear
            ):
                place = clear + vehicle.length_m / 2 + float(rng.gamma(1.2, headway_m / 2))
            self._movers.append(
                Mover(
                    poses=(vehicle.mesh,),
                    cycle_m=1.0,
                    s=self._following(place) if own else _steady(place, speed),
                    t=style.lane_centre_m(lane) + float(rng.normal(0, 0.15)),
                    height_m=0.0,
                    backwards=oncoming,
                )
            )
            place += vehicle.length_m / 2 + gap

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
            if side.walk_m <= 0:
                continue
            rate = style.people_per_100m * people / 100
            for forwards in (True, False):
                low, high = self._needed(1.35 if forwards else -1.35)
                for _ in range(int(rng.poisson(rate / 2 * (high - low)))):
                    speed = float(rng.uniform(0.9, 1.6)) * (1 if forwards else -1)
                    walker = self._library.draw_walker(rng)
                    out = side.walk_start_m + float(rng.uniform(0.5, max(side.walk_m - 0.4, 0.6)))
                    self._movers.append(
                        Mover(
                            walker.poses,
                            STEP_M,
                            _steady(float(rng.uniform(low, high)), speed),
                            sign * (edge + out),
                            style.kerb_m,
                            not forwards,
                        )
                    )
            if rng.random() < 0.7 * people:
                self._fill_cyclists(rng, sign, edge)

    def _fill_cyclists(self, rng: np.random.Generator, sign: int, edge: float) -> None:
        speed = float(rng.uniform(3, 6.5)) * -sign
        low, high = self._needed(speed)
        for place in np.arange(low, high, float(rng.uniform(60, 250))):
            mesh = self._library.cyclists[int(rng.integers(len(self._library.cyclists)))]
            start = float(place + rng.uniform(0, 30))
            self._movers.append(Mover((mesh,), 1.0, _steady(start, speed), sign * (edge - 0.35), 0.0, sign > 0))


def _steady(place: float, speed: float) -> Callable[[float], float]:
    return lambda time: place + speed * time
