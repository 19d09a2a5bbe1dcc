"""The light of a seed: sun, sky and air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.configuration import Weather
from radcam_depth_ros.simulation.style import Colour


@dataclass(frozen=True)
class Light:
    """Sun, sky and air of a seed; intensities are relative to a white surface under the open sky.

    Attributes:
        sun_direction: Unit vector towards the sun, world axes.
        sun: (R, G, B) of direct light on a surface that faces the sun; 0 under an overcast sky.
        sky: (R, G, B) of the light from all of the sky.
        zenith: Colour of the sky above.
        horizon: Colour of the sky low down.
        cloud_cover: 0 clear to 1 closed.
        cloud_contrast: How much clouds differ from one another.
        haze_m: Distance at which the air hides two thirds of what is behind.
        patches: How much large patches of light and shade on the ground differ, 0 for none.
    """

    sun_direction: tuple[float, float, float]
    sun: Colour
    sky: Colour
    zenith: Colour
    horizon: Colour
    cloud_cover: float
    cloud_contrast: float
    haze_m: float
    patches: float


def draw_light(rng: np.random.Generator, weather: Weather) -> Light:
    """Draws the light of a seed."""
    if weather is Weather.ANY:
        weather = [Weather.SUNNY, Weather.CLOUDY, Weather.OVERCAST][int(rng.choice(3, p=[0.3, 0.25, 0.45]))]
    elevation = np.deg2rad(rng.uniform(8, 65))
    azimuth = rng.uniform(0, 2 * np.pi)
    direction = (
        float(np.cos(elevation) * np.cos(azimuth)),
        float(np.cos(elevation) * np.sin(azimuth)),
        float(np.sin(elevation)),
    )
    warmth = float(np.clip(1.25 - elevation, 0, 1))
    strength = {Weather.SUNNY: rng.uniform(2.0, 4.5), Weather.CLOUDY: rng.uniform(0.3, 2.0), Weather.OVERCAST: 0.0}[
        weather
    ]
    sun = strength * np.array([1.0, 0.93 - 0.2 * warmth, 0.82 - 0.42 * warmth])
    cover = {Weather.SUNNY: rng.uniform(0, 0.4), Weather.CLOUDY: rng.uniform(0.35, 0.85), Weather.OVERCAST: 1.0}[
        weather
    ]
    tint = rng.normal(0, 0.03)
    cloud = np.array([0.95 + tint, 0.98, 1.03 - tint]) * rng.uniform(0.8, 1.3)
    blue = np.array([0.22, 0.42, 0.85]) * rng.uniform(0.6, 1.1)
    pale = np.array([0.75, 0.84, 0.95]) * rng.uniform(0.8, 1.2)
    clear = weather is not Weather.OVERCAST
    zenith = blue if clear else cloud * rng.uniform(0.9, 1.3)
    horizon = pale if clear else cloud * rng.uniform(0.7, 1.2)
    sky = (0.55 * blue + 0.35 * pale) * (1 - cover) + cloud * cover if clear else cloud
    return Light(
        sun_direction=direction,
        sun=_triple(sun),
        sky=_triple(sky),
        zenith=_triple(zenith),
        horizon=_triple(horizon),
        cloud_cover=float(cover),
        cloud_contrast=float(rng.uniform(0.05, 0.5)),
        haze_m=float(np.exp(rng.uniform(np.log(250), np.log(6000)))),
        patches=float(rng.uniform(0, 0.6)) if rng.random() < 0.7 else 0.0,
    )


def _triple(values: npt.NDArray[np.float64]) -> Colour:
    r, g, b = (float(value) for value in values)
    return r, g, b
