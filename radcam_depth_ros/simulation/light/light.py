"""Draws the light of a seed: sun, sky, air and lamps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.simulation.materials.surfaces import Colour
from radcam_depth_ros.simulation.settings.configuration import TimeOfDay, Weather, WorldConfig
from radcam_depth_ros.simulation.settings.randomness import log_uniform, pick

FULL_LUX = 15000.0
"""Light on open ground under a bright overcast sky: the unit of all intensities here."""

_WEATHERS = (Weather.SUNNY, Weather.CLOUDY, Weather.OVERCAST, Weather.RAIN, Weather.FOG)
_TIMES = (TimeOfDay.DAY, TimeOfDay.DUSK, TimeOfDay.NIGHT)


@dataclass(frozen=True)
class Light:
    """Sun, sky and air of a seed; intensities are relative to a white surface under the open sky.

    Attributes:
        weather: Sky and air, never ANY.
        time_of_day: Day, dusk or night, never ANY.
        sun_direction: Unit vector towards the sun, world axes.
        sun: (R, G, B) of direct light on a surface that faces the sun; 0 where it is hidden or has set.
        sun_size: Half the angle over which the sun's light comes, radians: how soft shadows are.
        sky: (R, G, B) of the light from all of the sky.
        zenith: Colour of the sky above.
        horizon: Colour of the sky low down.
        glow: (R, G, B) that the horizon has more of below the sun.
        cloud_cover: 0 clear to 1 closed.
        cloud_contrast: How much clouds differ from one another.
        haze: (R, G, B) of the air where nothing is behind.
        haze_m: Distance at which the air hides two thirds of what is behind.
        patches: How much large patches of light and shade on the ground differ, 0 for none.
        depth: How dark corners and undersides are, 0 (no difference) to 1.
        signals: Radiance of traffic lights and of all other lamps.
        rain: How much rain falls, 0 to 1.
        wetness: How wet the road is at least, 0 to 1.
        head_lamps: Radiance of vehicles' head lamps.
        tail_lamps: Radiance of vehicles' tail lamps.
        braking: Radiance that tail lamps have more of where a vehicle brakes.
        beam_candela: Strength of the head lamps' beams, the own ones' included; 0 where they make no difference.
        street_lamps: (R, G, B) of the strength of street lamps, candela; 0 by day.
        lit_windows: Share of the windows with light behind.
        random: Whether the colours are such that no weather has them.
    """

    weather: Weather
    time_of_day: TimeOfDay
    sun_direction: tuple[float, float, float]
    sun: Colour
    sun_size: float
    sky: Colour
    zenith: Colour
    horizon: Colour
    glow: Colour
    cloud_cover: float
    cloud_contrast: float
    haze: Colour
    haze_m: float
    patches: float
    depth: float
    signals: float
    rain: float = 0.0
    wetness: float = 0.0
    head_lamps: float = 0.0
    tail_lamps: float = 0.0
    braking: float = 0.0
    beam_candela: float = 0.0
    street_lamps: Colour = (0.0, 0.0, 0.0)
    lit_windows: float = 0.0
    random: bool = False


def draw_light(rng: np.random.Generator, config: WorldConfig) -> Light:
    """Draws the light of a seed."""
    weather, time = config.weather, config.time_of_day
    any_weather = pick(rng, _WEATHERS, (0.24, 0.18, 0.36, 0.13, 0.09))
    any_time = pick(rng, _TIMES, (0.76, 0.11, 0.13))
    weather = any_weather if weather is Weather.ANY else weather
    time = any_time if time is TimeOfDay.ANY else time
    light = _with_lamps(rng, _draw_air(rng, _draw_sky(rng, weather, time)))
    return _randomised(rng, light) if rng.random() < config.random_light else light


def _draw_sky(rng: np.random.Generator, weather: Weather, time: TimeOfDay) -> Light:
    """Sun and sky, with clear air and nothing that shines."""
    clear = weather in (Weather.SUNNY, Weather.CLOUDY)
    # Low suns are common where winters are long.
    elevation = np.deg2rad(4 + 58 * rng.random() ** 1.6) if time is TimeOfDay.DAY else np.deg2rad(rng.uniform(0.5, 5))
    azimuth = rng.uniform(0, 2 * np.pi)
    direction = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    warmth = float(np.clip(1.15 - 1.7 * elevation, 0, 1))
    strength = {Weather.SUNNY: rng.uniform(2.0, 5.0), Weather.CLOUDY: rng.uniform(0.3, 2.0)}.get(weather, 0.0)
    cover = {Weather.SUNNY: rng.uniform(0, 0.4), Weather.CLOUDY: rng.uniform(0.35, 0.85)}.get(weather, 1.0)
    sun = strength * np.array([1.0, 0.93 - 0.2 * warmth, 0.82 - 0.42 * warmth])
    tint = rng.normal(0, 0.035)
    cloud = np.array([0.95 + tint, 0.98, 1.03 - tint]) * rng.uniform(0.8, 1.3)
    blue = np.array([0.22, 0.42, 0.85]) * rng.uniform(0.6, 1.1)
    pale = np.array([0.75, 0.84, 0.95]) * rng.uniform(0.8, 1.2)
    # Thick clouds are brighter above than low down, thin ones the other way around.
    zenith = blue if clear else cloud * rng.uniform(0.9, 1.6)
    horizon = pale if clear else cloud * rng.uniform(0.8, 2.0)
    sky = (0.55 * blue + 0.35 * pale) * (1 - cover) + cloud * cover if clear else cloud
    glow = np.zeros(3)
    if time is TimeOfDay.DUSK:
        # From the last minutes of sun to the end of twilight.
        level = log_uniform(rng, 0.004, 0.25)
        cool = np.array([0.75, 0.9, 1.25])
        sun = sun * (0.5 * level if level > 0.1 else 0.0) * np.array([1.0, 0.7, 0.45])
        glow = level * np.array([2.0, 0.9, 0.35]) * rng.uniform(0.2, 1.2) * (1.0 if clear else 0.15)
        sky, zenith, horizon = (level * cool * part for part in (sky, zenith, horizon))
    elif time is TimeOfDay.NIGHT:
        # The glow of towns, which clouds send back.
        level = log_uniform(rng, 1e-5, 2.5e-4)
        town = np.array([1.0, 0.8, 0.6]) * (1.5 if cover > 0.5 else 0.7) + np.array([0.0, 0.1, 0.3])
        sun = sun * 0
        sky, zenith, horizon = level * town, level * town * 0.6, level * town * rng.uniform(1, 2.5)
    return Light(
        weather=weather,
        time_of_day=time,
        sun_direction=_triple(direction),
        sun=_triple(sun),
        sun_size=0.005 if weather is Weather.SUNNY else rng.uniform(0.01, 0.06),
        sky=_triple(sky),
        zenith=_triple(zenith),
        horizon=_triple(horizon),
        glow=_triple(glow),
        cloud_cover=float(cover),
        cloud_contrast=rng.uniform(0.05, 0.5),
        haze=_triple(horizon * 0.9),
        haze_m=log_uniform(rng, 500, 10000),
        patches=rng.uniform(0, 0.6) if rng.random() < 0.7 else 0.0,
        depth=rng.uniform(0.8, 1.0),
        signals=rng.uniform(0.5, 2.5),
    )


def _draw_air(rng: np.random.Generator, light: Light) -> Light:
    """Rain and fog."""
    if light.weather is Weather.RAIN:
        return replace(
            light,
            rain=rng.uniform(0.15, 1.0),
            wetness=rng.uniform(0.5, 1.0),
            haze_m=log_uniform(rng, 180, 1500),
        )
    if light.weather is Weather.FOG:
        return replace(
            light,
            haze_m=log_uniform(rng, 30, 220),
            haze=_triple(np.array(light.sky) * rng.uniform(0.75, 1.05)),
            wetness=rng.uniform(0, 0.5),
            cloud_contrast=light.cloud_contrast * 0.3,
        )
    return light


def _with_lamps(rng: np.random.Generator, light: Light) -> Light:
    """Lamps: by day some drive with them on, in the dark all do."""
    dark = light.time_of_day is not TimeOfDay.DAY
    dull = dark or max(light.sun) < 0.5
    braking = rng.uniform(0.8, 3.0) if rng.random() < 0.35 else 0.0
    lit = replace(
        light,
        head_lamps=log_uniform(rng, 2, 12) if dull and rng.random() < 0.75 else 0.3,
        tail_lamps=rng.uniform(0.2, 1.0) if dull and rng.random() < 0.6 else 0.0,
        braking=braking,
    )
    if not dark:
        return lit
    sodium, white = np.array([1.4, 0.85, 0.3]), np.array([1.0, 0.95, 0.85])
    colour = sodium if rng.random() < 0.4 else white * rng.uniform(0.9, 1.1, 3)
    burning = light.time_of_day is TimeOfDay.NIGHT or max(light.sky) < 0.05
    return replace(
        lit,
        tail_lamps=rng.uniform(0.15, 0.8),
        beam_candela=log_uniform(rng, 8000, 30000),
        street_lamps=_triple(colour * rng.uniform(500, 4000)) if burning and rng.random() < 0.75 else (0.0, 0.0, 0.0),
        lit_windows=rng.uniform(0, 0.4) if rng.random() < 0.8 else 0.0,
        signals=rng.uniform(0.3, 1.5),
    )


def _randomised(rng: np.random.Generator, light: Light) -> Light:
    """Light that no weather gives: what stays the same is shape."""
    level = max(light.sky)

    def colour(spread: float) -> Colour:
        # Brightness is free, the tint is one that lamps and skies have.
        return _triple(level * np.exp(rng.normal(0, spread)) * np.exp(rng.normal(0, 0.12, 3)))

    sunny = rng.random() < 0.5
    return replace(
        light,
        random=True,
        sun=_triple(np.array(colour(0.5)) * rng.uniform(0.3, 4)) if sunny else (0.0, 0.0, 0.0),
        sun_direction=_triple(_unit(rng.normal(0, 1, 3) * [1, 1, 0] + [0, 0, rng.uniform(0.1, 2)])),
        sun_size=rng.uniform(0.005, 0.3),
        sky=colour(0.35),
        zenith=colour(0.7),
        horizon=colour(0.7),
        haze=colour(0.5),
        haze_m=log_uniform(rng, 60, 8000),
        cloud_cover=rng.random(),
        depth=pick(rng, (0.0, rng.random(), 1.0)),
        patches=rng.uniform(0, 0.8),
    )


def _unit(vector: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector), np.float64)


def _triple(values: npt.NDArray[np.floating]) -> Colour:
    r, g, b = (float(value) for value in values)
    return r, g, b
