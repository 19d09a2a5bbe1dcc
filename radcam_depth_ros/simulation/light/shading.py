"""Shades hits of rays: sun with shadows, sky with occlusion, lamps, mirror reflections, haze."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray
from radcam_depth_ros.simulation.light.lamps import VEHICLES, Lamps
from radcam_depth_ros.simulation.light.light import Light
from radcam_depth_ros.simulation.light.surroundings import Surroundings
from radcam_depth_ros.simulation.materials.surfaces import Label, Surface, surface_table
from radcam_depth_ros.simulation.materials.textures import TextureAtlas
from radcam_depth_ros.simulation.materials.tiles import fractal
from radcam_depth_ros.simulation.materials.wear import WEAR_M, road_wear
from radcam_depth_ros.simulation.objects.scene import Hits, Scene
from radcam_depth_ros.simulation.settings.looks import NO_LOOKS, Looks

_NOISE = 512
_MIST_M = 120.0  # how high fog reaches
_MIRRORS = (Surface.GLASS, Surface.BODYWORK, Surface.MASONRY)
_GROUND = (Surface.ASPHALT, Surface.PAVING, Surface.GROUND, Surface.PAINT_MARK)


@dataclass(frozen=True)
class Hit:
    """Where rays met something, as columns of the N rays that did.

    Attributes:
        face: (N,) int32, faces of the scene.
        point: (N, 3) float32, world.
        normal: (N, 3) float32, unit shading normal towards the viewer.
        direction: (N, 3) float32, unit direction of the ray.
        range_m: (N,) float32.
        weight: (N, 3) float32, barycentric coordinates.
    """

    face: npt.NDArray[np.int32]
    point: FloatArray
    normal: FloatArray
    direction: FloatArray
    range_m: FloatArray
    weight: FloatArray


def locate(scene: Scene, hits: Hits, origin: npt.NDArray[np.floating], directions: FloatArray) -> Hit:
    """Points and normals of rays that all met something; the rays start at one origin (3,)."""
    length = np.sqrt(np.einsum("ni,ni->n", directions, directions))
    unit = directions / length[:, None]
    point = directions * hits.distance_m[:, None] + np.asarray(origin, np.float32)
    weight = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
    normal = np.einsum("nci,nc->ni", scene.faces.normals[hits.face], weight)
    normal /= np.sqrt(np.einsum("ni,ni->n", normal, normal))[:, None] + np.float32(1e-9)
    away = np.einsum("ni,ni->n", normal, unit) > 0
    normal[away] *= -1
    return Hit(hits.face, point, normal, unit, hits.distance_m * length, weight)


class Shader:
    """Turns hits into radiance, relative to a white surface under the open sky."""

    def __init__(
        self, rng: np.random.Generator, atlas: TextureAtlas, light: Light, wetness: float, looks: Looks = NO_LOOKS
    ) -> None:
        self._atlas = atlas
        self.light = light
        """The light that it shades by."""
        triples = (light.sun_direction, light.sun, light.sky, light.zenith, light.horizon, light.glow, light.haze)
        self._towards_sun, self._sun, self._sky, self._zenith, self._horizon, self._glow, self._haze = (
            np.array(triple, np.float32) for triple in triples
        )
        wetness = max(wetness, light.wetness)
        table = surface_table()
        self._gloss = table.gloss.copy()
        self._gloss[[Surface.ASPHALT, Surface.PAINT_MARK]] = 0.75 * wetness
        self._gloss[[Surface.PAVING, Surface.GROUND]] += 0.3 * wetness
        self._dampening = np.ones(len(Surface), np.float32)
        self._dampening[[Surface.ASPHALT, Surface.PAVING, Surface.GROUND]] = 1 - 0.5 * wetness
        self._rough = np.isin(np.arange(len(Surface)), _GROUND)
        self._noise = fractal(rng, _NOISE, 1.0)
        self._clouds = fractal(rng, _NOISE, 1.7, 2)
        self._blotches = rng.uniform(0.02, 0.25)
        self._tilt = rng.normal(0, 0.12, 3).astype(np.float32)
        self._skyline = rng.uniform(0.1, 0.5)
        self.beams = looks.beams
        """Whether head lamps have a bright middle, see `shining_lamps`."""
        self._surroundings = Surroundings(rng) if looks.reflections else None
        self._mirrors = np.isin(np.arange(len(Surface)), _MIRRORS)
        self._wear = road_wear(rng) if looks.wear else None

    @property
    def open_sky(self) -> FloatArray:
        """(3,) float32 light from all of the sky."""
        return self._sky

    def sky(self, direction: FloatArray) -> FloatArray:
        """Radiance (N, 3) of the sky in unit directions (N, 3)."""
        light = self.light
        colour = self._clear_sky(direction)
        up = np.maximum(direction[:, 2], 0.0)
        scale = 0.6 / (up + 0.12)
        cloud = self._look_up(self._clouds, direction[:, 0] * scale * 60, direction[:, 1] * scale * 60, 100.0)
        if light.cloud_cover < 1:
            # Clouds are as bright as what lights them.
            amount = np.clip((cloud - 1.5 + 3.0 * light.cloud_cover) * 1.2, 0, 1)[:, None]
            lighting = self._sky.max() + self._sun.max() * np.float32(0.15)
            white = self._sky * np.float32(0.2) + lighting * np.float32(0.7)
            colour = colour * (1 - amount) + white * amount * (1 + 0.25 * light.cloud_contrast * cloud[:, None])
        else:
            colour = colour * np.clip(1 + light.cloud_contrast * 0.5 * cloud, 0.3, 2)[:, None]
        glow = np.maximum(direction @ self._towards_sun, 0)
        if self._sun.max() > 0:
            halo = 0.06 * _power(glow, 3) + 0.5 * _power(glow, 6) + 20.0 * (glow > 0.9995)
            colour = colour + self._sun * halo[:, None]
        # A ray that leaves the mist at its top has gone the longer through it the flatter it is.
        air = np.exp(np.float32(-_MIST_M / light.haze_m) / (up + np.float32(0.02)))[:, None]
        return np.asarray(colour * air + self._haze * (1 - air), np.float32)

    def _clear_sky(self, direction: FloatArray) -> FloatArray:
        up = np.maximum(direction[:, 2], 0.0)
        blend = np.sqrt(up)[:, None]
        colour = self._horizon * (1 - blend) + self._zenith * blend
        if self._glow.max() > 0:
            around = 0.5 + 0.5 * (direction[:, 0] * self._towards_sun[0] + direction[:, 1] * self._towards_sun[1])
            colour = colour + self._glow * (_power(np.maximum(around, 0), 2) * _power(1 - up, 3))[:, None]
        return np.asarray(colour, np.float32)

    def shade(
        self,
        scene: Scene,
        hit: Hit,
        openness: FloatArray,
        lamps: Lamps,
        pixel_angle: float,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Radiance (N, 3) float32 of hits.

        Args:
            scene: What was hit, and what casts shadows.
            hit: The hits.
            openness: (N,) share of the sky that each sees.
            lamps: Lamps that light what is around them.
            pixel_angle: Radians that a pixel covers.
            rng: For the sun's soft edge.
        """
        light = self.light
        surface = scene.faces.surface[hit.face]
        cosine = np.clip(-np.einsum("ni,ni->n", hit.normal, hit.direction), 0.03, 1)
        albedo, shine = self._albedo(scene, hit, surface, cosine, pixel_angle)
        patch = self._patches(hit.point)
        upward = hit.normal[:, 2]
        openness = 1 - np.float32(light.depth) * (1 - openness)
        ambient = (0.55 + 0.45 * upward + hit.normal @ self._tilt) * openness
        bounce = (0.5 - 0.5 * upward) * (0.04 + 0.22 * openness)
        irradiance = self._sky * ((ambient + bounce) * (0.5 + 0.5 * patch))[:, None]
        lit = np.zeros(len(surface), np.float32)
        if self._sun.max() > 0:
            lit = self._sunlight(scene, hit, rng) * patch
            irradiance += self._sun * (lit * np.maximum(hit.normal @ self._towards_sun, 0))[:, None]
            irradiance += self._sun * (0.10 * openness * (1 - 0.5 * upward))[:, None]
        if len(lamps.place):
            irradiance += lamps.light(hit.point, hit.normal) * (0.3 + 0.7 * openness)[:, None]
        colour = albedo * irradiance
        self._reflect(colour, hit, surface, shine, cosine, openness, lit)
        self._emit(colour, scene, hit, surface, shine)
        air = np.exp(-hit.range_m / np.float32(light.haze_m))[:, None]
        return np.asarray(colour * air + self._haze * (1 - air), np.float32)

    def _emit(
        self, colour: FloatArray, scene: Scene, hit: Hit, surface: npt.NDArray[np.uint8], shine: FloatArray
    ) -> None:
        """Adds what lamps and lit windows send out, in place."""
        light = self.light
        lamp = np.flatnonzero(surface == Surface.LAMP)
        glass, label = scene.faces.colour[hit.face[lamp]], scene.faces.label[hit.face[lamp]]
        vehicle = np.isin(label, VEHICLES)
        red = glass[:, 0] > 4 * glass[:, 1]
        # The speed is a vehicle's own and stays for some frames: it decides who brakes.
        speed = np.abs(scene.velocity[hit.face[lamp]]).sum(axis=1)
        braking = light.braking * ((speed * np.float32(0.7)) % 1 < 0.5)
        strength = np.where(red, light.tail_lamps + braking, light.head_lamps)
        street = 12.0 * (max(light.street_lamps) > 0)
        strength = np.where(vehicle, strength, np.where(label == Label.POLE, street, light.signals))
        colour[lamp] += glass * strength[:, None].astype(np.float32)
        if light.lit_windows > 0:
            window = np.flatnonzero((surface == Surface.MASONRY) & (shine > 0.5))
            colour[window] += self._window_light(scene, hit, window)

    def _window_light(self, scene: Scene, hit: Hit, window: npt.NDArray[np.integer]) -> FloatArray:
        """Radiance (K, 3) of windows: each is lit or dark as its place on the facade says."""
        faces = scene.faces
        uv = np.einsum("nci,nc->ni", faces.uv[hit.face[window]], hit.weight[window])
        # A tile of a facade holds two windows by two; the wall's plane tells one house from another.
        column, row = np.floor(uv[:, 0] * 2), np.floor(uv[:, 1] * 2)
        house = np.floor(np.abs(faces.colour[hit.face[window]]).sum(axis=1) * 97)
        chance = np.abs(np.sin(column * 12.9898 + row * 78.233 + house * 37.719) * 43758.547) % 1
        warm = np.array([1.0, 0.72, 0.42], np.float32) * (chance * 37 % 1)[:, None] + np.float32(0.1)
        lit = (chance < self.light.lit_windows)[:, None]
        return np.asarray(warm * lit * np.float32(0.012), np.float32)

    def _albedo(
        self, scene: Scene, hit: Hit, surface: npt.NDArray[np.uint8], cosine: FloatArray, pixel_angle: float
    ) -> tuple[FloatArray, FloatArray]:
        faces = scene.faces
        corners_uv = faces.uv[hit.face]
        uv = np.einsum("nci,nc->ni", corners_uv, hit.weight)
        footprint = hit.range_m * np.float32(pixel_angle) / np.sqrt(cosine)
        density = scene.tiles_per_metre[hit.face]
        texture, shine = self._atlas.sample(faces.texture[hit.face], uv, footprint * density)
        albedo = texture * faces.colour[hit.face] * self._dampening[surface][:, None]
        # Blotches in the world, larger than the textures: they hide that tiles repeat.
        rough = np.flatnonzero(self._rough[surface])
        x, y, size = hit.point[rough, 0], hit.point[rough, 1], footprint[rough]
        blotch = self._look_up(self._noise, x, y, 31.0) * self._blotches
        blotch += self._look_up(self._noise, y, x, 2.3) * 0.10 * np.clip(1.5 - size / 0.03, 0, 1)
        albedo[rough] *= np.exp(blotch)[:, None]
        if self._wear is not None:
            sealed = rough[(surface[rough] == Surface.ASPHALT) & (footprint[rough] < 0.3)]
            albedo[sealed] *= self._worn(hit.point[sealed])[:, None]
        return np.minimum(albedo, 1.0), shine

    def _worn(self, point: FloatArray) -> FloatArray:
        """Factors (N,) of the albedo of a road at points (N, 3)."""
        if self._wear is None:
            return np.ones(len(point), np.float32)
        size = len(self._wear)
        place = np.floor(point[:, :2] * np.float32(size / WEAR_M)).astype(np.int32) & (size - 1)
        return np.asarray(self._wear[place[:, 1], place[:, 0]], np.float32)

    def _patches(self, point: FloatArray) -> FloatArray:
        if self.light.patches <= 0:
            return np.ones(len(point), np.float32)
        noise = self._look_up(self._clouds, point[:, 0], point[:, 1] + point[:, 2], 160.0)
        return np.asarray(np.exp(self.light.patches * np.clip(noise, -2, 1.2)), np.float32)

    def _look_up(
        self, noise: FloatArray, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating], tile_m: float
    ) -> FloatArray:
        scale = np.float32(_NOISE / tile_m)
        column = np.floor(x * scale).astype(np.int32) & (_NOISE - 1)
        row = np.floor(y * scale).astype(np.int32) & (_NOISE - 1)
        return np.asarray(noise[row, column])

    def _sunlight(self, scene: Scene, hit: Hit, rng: np.random.Generator) -> FloatArray:
        direction = self._towards_sun
        facing = np.flatnonzero(hit.normal @ direction > 0)
        origins = hit.point[facing] + hit.normal[facing] * np.float32(4e-3)
        spread = rng.standard_normal((len(facing), 3), dtype=np.float32) * np.float32(self.light.sun_size)
        lit = np.zeros(len(hit.face), np.float32)
        lit[facing] = ~scene.occluded(origins, direction + spread, 300.0)
        return lit

    def _reflect(
        self,
        colour: FloatArray,
        hit: Hit,
        surface: npt.NDArray[np.uint8],
        shine: FloatArray,
        cosine: FloatArray,
        openness: FloatArray,
        lit: FloatArray,
    ) -> None:
        """Adds what glossy faces mirror, in place: sky above, a dark band at the horizon, the ground below."""
        gloss = self._gloss[surface] * shine
        some = np.flatnonzero(gloss > 0.02)
        normal, direction, angle = hit.normal[some], hit.direction[some], cosine[some]
        mirrored = direction + normal * (2 * angle)[:, None]
        base = np.where(surface[some] == Surface.GLASS, np.float32(0.09), np.float32(0.045))
        share = gloss[some] * (base + (1 - base) * _power(1 - angle, 2) * (1 - angle))
        above = np.clip((mirrored[:, 2:3] - 0.03) / 0.25, 0, 1)
        around = np.broadcast_to(self._sky * np.float32(self._skyline * 0.5), mirrored.shape)
        if self._surroundings is not None:
            # Wet roads mirror what stands on them, which no panorama knows.
            clear = np.flatnonzero(self._mirrors[surface[some]])
            seen, tone = self._surroundings.seen(mirrored[clear], hit.point[some[clear]])
            around = around.copy()
            above[clear], around[clear] = seen[:, None], self._sky * tone[:, None]
        reflected = self._clear_sky(mirrored) * above + around * (1 - above)
        reflected *= (0.35 + 0.65 * openness[some])[:, None]
        if self._sun.max() > 0:
            glint = _power(np.maximum(mirrored @ self._towards_sun, 0), 7)
            reflected += self._sun * (glint * lit[some] * 4)[:, None]
        colour[some] = colour[some] * (1 - share)[:, None] + reflected * share[:, None]


def _power(values: FloatArray, doublings: int) -> FloatArray:
    """Values to the power 2 ** doublings: numpy's own power takes longer than all the rest of the shading."""
    for _ in range(doublings):
        values = values * values
    return values
