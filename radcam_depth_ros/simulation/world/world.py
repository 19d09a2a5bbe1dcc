"""The world of a seed: street, light, own vehicle and traffic, and the scene around the vehicle at any time."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.simulation.light.light import draw_light
from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture, scaled
from radcam_depth_ros.simulation.materials.textures import TextureAtlas
from radcam_depth_ros.simulation.objects.disguise import Disguise
from radcam_depth_ros.simulation.objects.library import build_library
from radcam_depth_ros.simulation.objects.mesh import Mesh, join, sheet
from radcam_depth_ros.simulation.objects.scene import Scene
from radcam_depth_ros.simulation.settings.configuration import StreetKind, WorldConfig
from radcam_depth_ros.simulation.settings.looks import NO_LOOKS, Looks
from radcam_depth_ros.simulation.settings.randomness import Stream, generator
from radcam_depth_ros.simulation.settings.style import Land, draw_style
from radcam_depth_ros.simulation.world.centre_line import CentreLine
from radcam_depth_ros.simulation.world.ego import EgoDrive
from radcam_depth_ros.simulation.world.ground import lay_ground
from radcam_depth_ros.simulation.world.land import settle
from radcam_depth_ros.simulation.world.markings import paint_markings
from radcam_depth_ros.simulation.world.relief import Relief
from radcam_depth_ros.simulation.world.roadside import furnish
from radcam_depth_ros.simulation.world.street import STRETCH_M, Stretch
from radcam_depth_ros.simulation.world.structures import dig_tunnel
from radcam_depth_ros.simulation.world.traffic import Traffic
from radcam_depth_ros.simulation.world.works import set_up_works

_BEHIND_STRETCHES = 2
_MOVE_STRETCHES = 2


class World:
    """All of a seed that does not depend on the sensors."""

    def __init__(self, seed: int, config: WorldConfig, duration_s: float, looks: Looks = NO_LOOKS) -> None:
        """Builds a world.

        Args:
            seed: Decides everything.
            config: The street and who is on it.
            duration_s: How long the drive will be; traffic comes into view until then.
            looks: What the pictures have; nothing without.
        """
        self._seed, self._config = seed, config
        rng = generator(seed, Stream.STYLE)
        self.style = draw_style(rng, config)
        self.light = draw_light(rng, config)
        self._wear = rng.uniform(0.2, 0.85)
        self._first_junction = int(rng.integers(2))
        reach_m = self.style.speed_mps * duration_s * 2 + config.view_m + 500
        self.path = CentreLine(generator(seed, Stream.PATH), -400.0, reach_m, self.style.min_radius_m, config.max_slope)
        disguise = generator(seed, Stream.DISGUISE)
        is_random = bool(disguise.random() < config.random_textures)
        self._disguise = Disguise(disguise) if is_random else None
        self.atlas = TextureAtlas(generator(seed, Stream.TEXTURES), is_random, looks.lettering, looks.wear)
        self._library = build_library(generator(seed, Stream.PROTOTYPES), self.style, looks.lettering)
        self.relief = Relief(generator(seed, Stream.RELIEF), config.max_slope)
        self.ego = EgoDrive(generator(seed, Stream.EGO), self.style, self.path, self.relief)
        self._traffic = Traffic(
            generator(seed, Stream.TRAFFIC),
            config,
            self.style,
            self.path,
            self.relief,
            self._library,
            self.ego,
            duration_s,
            [at for at in map(self._crossing_m, range(-1, int(reach_m / STRETCH_M))) if np.isfinite(at)],
        )
        self._stretches: dict[int, Mesh] = {}
        self._window: tuple[int, Scene] | None = None

    def scene_at(self, time: float) -> Scene:
        """The scene around the own vehicle at a time, seconds; valid until the next call."""
        here = int(np.floor(float(self.ego.s(time)) / STRETCH_M))
        # The window moves by whole steps, whatever the order of the calls: the same time gives the same scene.
        first = here // _MOVE_STRETCHES * _MOVE_STRETCHES - _BEHIND_STRETCHES
        if self._window is None or self._window[0] != first:
            self._window = (first, Scene(self._surroundings(first)))
        scene = self._window[1]
        movers = self._traffic.at(time)
        scene.set_movers([(self._dressed(mesh), velocity) for mesh, velocity in movers])
        return scene

    def _surroundings(self, first: int) -> Mesh:
        count = _BEHIND_STRETCHES + _MOVE_STRETCHES + int(np.ceil(self._config.view_m / STRETCH_M))
        wanted = range(first, first + count)
        self._stretches = {index: self._stretches[index] for index in wanted if index in self._stretches}
        for index in wanted:
            if index not in self._stretches:
                self._stretches[index] = self._build_stretch(index)
        middle = (first + count / 2) * STRETCH_M
        return join([*(self._stretches[index] for index in wanted), self._dressed(self._horizon(middle))])

    def _dressed(self, mesh: Mesh) -> Mesh:
        return mesh if self._disguise is None else self._disguise.worn_by(mesh)

    def _build_stretch(self, index: int) -> Mesh:
        # Negative numbers are no seeds.
        rng = generator(self._seed, Stream.CHUNK, index + 1_000_000)
        stretch = Stretch(
            index * STRETCH_M,
            self.path,
            self.style,
            self._library,
            rng,
            self._config.people,
            crossing_m=self._crossing_m(index),
            land={sign: self._land(index, sign) for sign in (1, -1)},
            is_covered=self._is_covered(index),
        )
        lay_ground(stretch)
        paint_markings(stretch, self._wear)
        if stretch.is_covered:
            dig_tunnel(stretch, not self._is_covered(index - 1), not self._is_covered(index + 1))
        else:
            furnish(stretch)
            if self.style.special is StreetKind.CONSTRUCTION and rng.random() < 0.8:
                set_up_works(stretch)
            for sign in (1, -1):
                settle(stretch, sign, stretch.land[sign])
        return self._dressed(self.relief.lifted(join(stretch.parts)))

    def _crossing_m(self, index: int) -> float:
        """Where in a stretch a side road crosses, NaN where none does."""
        if self._is_covered(index):
            return float("nan")
        if self.style.special is StreetKind.JUNCTION:
            here = (index - self._first_junction) % 3 == 0
        else:
            own = generator(self._seed, Stream.CHUNK, index + 1_000_000, 9)
            here = bool(own.random() < self.style.crossings)
        return (index + 0.6) * STRETCH_M if here else float("nan")

    def _is_covered(self, index: int) -> bool:
        """Whether a stretch is in a tunnel: the first that is seen may be, later ones come in groups of five."""
        if self.style.special is not StreetKind.TUNNEL:
            return False
        group = generator(self._seed, Stream.CHUNK, (index + 1_000_000 + self._first_junction) // 5, 10)
        return bool(group.random() < 0.65)

    def _land(self, index: int, sign: int) -> Land:
        # Land goes on over several stretches: each group of three draws once, some stretches differ.
        rng = generator(self._seed, Stream.CHUNK, (index + 1_000_000) // 3, sign + 1, 7)
        usual = Land(int(rng.choice(len(Land), p=self.style.land)))
        own = generator(self._seed, Stream.CHUNK, index + 1_000_000, sign + 1, 8)
        return usual if own.random() < 0.8 else Land(int(own.choice(len(Land), p=self.style.land)))

    def _horizon(self, middle_s: float) -> Mesh:
        """The plain out to the horizon, and hills or woods that close it."""
        rng = generator(self._seed, Stream.STYLE, 1)
        x, y = self.path.position(middle_s, 0.0)
        colour = (0.8, 0.82, 0.85) if self.style.snow else self.style.grass
        plain = Material(Surface.GROUND, Label.TERRAIN, colour, Texture.SOIL, 40.0)
        # Fine enough to follow the relief where it can be seen, a little below it so that it never comes through.
        fall = max(0.0, -self.style.left.bank_m, -self.style.right.bank_m) * 1.6 + 0.7
        place = np.concatenate([[-4000.0, -1500.0], np.linspace(-750, 750, 31), [1500.0, 4000.0]])
        east, north = np.meshgrid(x + place, y + place, indexing="ij")
        floor = sheet(np.stack([east, north, self.relief.height(east, north) - fall], axis=-1), plain)
        angle = np.linspace(0, 2 * np.pi, 181)
        radius = rng.uniform(700, 2500)
        height = radius * rng.uniform(0.005, 0.05)
        waves = sum(rng.uniform(0.1, 0.4) * np.sin(k * angle + rng.uniform(0, 6.28)) for k in (2, 3, 5, 9, 14, 23, 37))
        crest = height * (1 + np.clip(np.asarray(waves), -0.9, 1.5))
        ring = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], -1)
        foot = np.concatenate([ring, np.full((181, 1), -5.0)], -1)
        top = np.concatenate([ring * 1.0, crest[:, None]], -1)
        colour = self.style.foliage if self.style.bare < 0.5 else self.style.twig
        wood = Material(Surface.FOLIAGE, Label.VEGETATION, scaled(colour, 0.8), Texture.LEAF, 60.0)
        uv = np.stack(
            [np.tile(angle * radius / 60.0, (2, 1)), np.repeat([[0.0], [1.0]], 181, axis=1) * height / 60], -1
        )
        return join([floor, sheet(np.stack([foot, top]), wood, uv)])
