"""Draws the times at which each sensor measures."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from radcam_depth_ros.simulation.settings.configuration import SimulationConfig
from radcam_depth_ros.simulation.settings.randomness import Stream, generator

LEAD_S = 1.0
"""Time of the first image in the drive: sweeps before it have a past."""


class Sensor(str, Enum):
    """Sensors of the vehicle."""

    ODOMETRY = "odometry"
    RADAR = "radar"
    IMAGING_RADAR = "imaging_radar"
    LIDAR = "lidar"
    CAMERA = "camera"


@dataclass(frozen=True)
class Event:
    """One measurement.

    Attributes:
        time_s: In the drive.
        sensor: Whose.
        index: Number of the measurement of this sensor, from 0.
    """

    time_s: float
    sensor: Sensor
    index: int


def draw_timetable(seed: int, config: SimulationConfig, frames: int) -> tuple[Event, ...]:
    """All measurements of a drive in the order of their times; each sensor keeps its own clock, out of phase."""
    rng = generator(seed, Stream.CLOCKS)
    images = LEAD_S + np.arange(frames) / config.camera.rate_hz
    events = [Event(float(time), Sensor.CAMERA, index) for index, time in enumerate(images)]
    for sensor, rate_hz, enabled in (
        (Sensor.ODOMETRY, config.odometry.rate_hz, config.odometry.enabled),
        (Sensor.RADAR, config.radar.rate_hz, config.radar.enabled),
        (Sensor.IMAGING_RADAR, config.imaging_radar.rate_hz, config.imaging_radar.enabled),
        (Sensor.LIDAR, config.lidar.rate_hz, config.lidar.enabled),
    ):
        phase = rng.random()
        if not enabled:
            continue
        # Number n measures at (n + phase) / rate; the first is the last one before the first image.
        place = images * rate_hz - phase
        if config.key_frames:
            numbers = np.unique(np.round(place).astype(np.int64))
        else:
            numbers = np.arange(np.floor(place[0]), np.ceil(place[-1]) + 1).astype(np.int64)
        numbers = numbers[numbers >= 0]
        events += [Event(float((number + phase) / rate_hz), sensor, int(number)) for number in numbers]
    order = list(Sensor)
    return tuple(sorted(events, key=lambda event: (event.time_s, order.index(event.sensor))))
