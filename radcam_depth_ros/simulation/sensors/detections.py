"""Detections of a radar: resolution cells above the threshold, and false ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.sensors.echoes import Echoes
from radcam_depth_ros.simulation.sensors.radar_unit import RadarUnit

_DECIBELS = 10 / np.log(10)


@dataclass(frozen=True)
class Cells:
    """Resolution cells of a radar.

    Attributes:
        range_m: Metres.
        azimuth: Radians straight ahead; an array's cells are even in the sine of the azimuth.
        elevation: Radians.
        speed_mps: Metres a second.
    """

    range_m: float
    azimuth: float
    elevation: float
    speed_mps: float


def gather(echoes: Echoes, cells: Cells) -> Echoes:
    """Merges the echoes of each resolution cell: sections add up, the rest is their weighted mean."""
    if not len(echoes):
        return echoes
    flat = np.zeros(len(echoes), np.int64)
    for values, size in (
        (echoes.range_m, cells.range_m),
        (np.sin(echoes.azimuth), cells.azimuth),
        (echoes.elevation, cells.elevation),
        (echoes.speed_mps, cells.speed_mps),
    ):
        flat = flat * 8192 + np.round(values / np.float32(size)).astype(np.int64)
    _, cell = np.unique(flat, return_inverse=True)
    total = np.bincount(cell, echoes.section_m2)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(cell, echoes.section_m2 * values) / np.maximum(total, 1e-20), np.float32)

    return Echoes(
        mean(echoes.range_m),
        mean(echoes.azimuth),
        mean(echoes.elevation),
        np.asarray(total, np.float32),
        mean(echoes.speed_mps),
        mean(echoes.ground_speed_mps),
    )


def level_db(echoes: Echoes, unit: RadarUnit) -> FloatArray:
    """How far each echo stands above the threshold, (N,) dB.

    With the fourth power of the range beyond 50 m; nearer it falls slowly: a radar damps what is near, or it would see
    every blade of grass.
    """
    decades = np.log10(np.maximum(echoes.range_m, 1.0) / 50)
    section_db = _DECIBELS * np.log(np.maximum(echoes.section_m2, 1e-9))
    return np.asarray(section_db - np.where(decades > 0, 40, 12) * decades - unit.threshold_dbsm, np.float32)


def detected(echoes: Echoes, unit: RadarUnit, rng: np.random.Generator) -> Echoes:
    """The cells that stand out of the noise, the strongest where there are too many."""
    level = level_db(echoes, unit) + rng.normal(0, 2.0, len(echoes))
    seen = np.flatnonzero((level > 0) & (rng.random(len(level)) >= unit.missed))
    strongest = seen[np.argsort(-level[seen], kind="stable")[: unit.max_points]]
    return echoes.some(np.sort(strongest))


def with_spread(echoes: Echoes, unit: RadarUnit, per_10_db: float, rng: np.random.Generator) -> Echoes:
    """Adds the weaker returns that a strong cell has around it: its neighbours in range, speed and angle see it too.

    Args:
        echoes: What was detected.
        unit: The radar.
        per_10_db: Returns more for each 10 dB above the threshold, on average.
        rng: Random generator.
    """
    level = np.maximum(level_db(echoes, unit), 0.0)
    parent = np.repeat(np.arange(len(echoes)), rng.poisson(per_10_db * level / 10))
    count, around = len(parent), echoes.some(parent)
    # Most lie within a beam, a few in its side lobes.
    aside = rng.normal(0, np.deg2rad(0.5), count) + (rng.random(count) < 0.15) * rng.normal(0, np.deg2rad(6.0), count)
    lower_db = level[parent] * rng.random(count)
    more = Echoes(
        np.maximum(around.range_m + rng.normal(0, 0.15, count), 0.2).astype(np.float32),
        np.clip(around.azimuth + aside, -unit.half_view, unit.half_view).astype(np.float32),
        around.elevation,
        (around.section_m2 * 10 ** (-lower_db / 10)).astype(np.float32),
        (around.speed_mps + rng.normal(0, 0.2, count)).astype(np.float32),
        around.ground_speed_mps,
    )
    return echoes.joined(more)


def with_false_echoes(echoes: Echoes, unit: RadarUnit, rng: np.random.Generator) -> Echoes:
    """Adds second echoes, echoes from nothing and, in some sweeps, the burst of another radar.

    So many returns as the radar gives are kept, true ones or not.
    """
    count = rng.poisson(unit.clutter)
    clutter = _from_nothing(rng.uniform(-unit.half_view, unit.half_view, count), unit, rng)
    everything = echoes.joined(_ghosts(echoes, unit, rng), clutter)
    if rng.random() < unit.config.interference:
        burst = int(unit.max_points * rng.uniform(0.05, 0.5))
        # The other radar is in one direction; its signal may also leak into all of them.
        spread = np.deg2rad(3.0) if rng.random() < 0.5 else unit.half_view
        azimuth = rng.uniform(-unit.half_view, unit.half_view) + rng.normal(0, spread, burst)
        everything = everything.joined(_from_nothing(np.clip(azimuth, -unit.half_view, unit.half_view), unit, rng))
    return everything.some(np.sort(rng.permutation(len(everything))[: unit.max_points]))


def _ghosts(echoes: Echoes, unit: RadarUnit, rng: np.random.Generator) -> Echoes:
    """Doubled ones, between a target and the own vehicle, and late ones, from within and below a target."""
    again = echoes.some(np.flatnonzero(rng.random(len(echoes)) < unit.ghosts))
    count = len(again)
    twice = rng.random(count) < 0.4
    longer = np.where(twice, 2 * again.range_m, again.range_m + rng.uniform(0.5, 15, count))
    turned = np.where(twice, again.azimuth, again.azimuth + rng.normal(0, 0.15, count))
    times = np.where(twice, 2, 1).astype(np.float32)
    found = Echoes(
        longer.astype(np.float32),
        np.clip(turned, -unit.half_view, unit.half_view).astype(np.float32),
        again.elevation,
        again.section_m2 * np.float32(0.1),
        again.speed_mps * times,
        again.ground_speed_mps * times,
    )
    return found.some(found.range_m < unit.config.max_range_m)


def _from_nothing(azimuth: npt.NDArray[np.floating], unit: RadarUnit, rng: np.random.Generator) -> Echoes:
    count = len(azimuth)
    range_m = rng.uniform(2, unit.config.max_range_m, count)
    speed = rng.normal(0, 8, count).astype(np.float32)
    decades = np.log10(range_m / 50)
    section_db = unit.threshold_dbsm + np.where(decades > 0, 40, 12) * decades + rng.exponential(4.0, count)
    return Echoes(
        range_m.astype(np.float32),
        azimuth.astype(np.float32),
        rng.normal(0, 0.08, count).astype(np.float32),
        (10 ** (section_db / 10)).astype(np.float32),
        speed,
        speed,
    )
