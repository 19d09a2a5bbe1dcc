"""The prototypes of a world: vehicles, people, animals and plants, built once and placed many times."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import LIVERIES, Colour, Surface, Texture, scaled
from radcam_depth_ros.simulation.objects.animals import AnimalKind, build_animal
from radcam_depth_ros.simulation.objects.bicycles import build_bicycle, build_motorcycle
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.objects.people import build_walker
from radcam_depth_ros.simulation.objects.plants import Plant, PlantKind, build_plant
from radcam_depth_ros.simulation.objects.vehicle_parts import Vehicle, VehicleKind
from radcam_depth_ros.simulation.objects.vehicles import build_vehicle, paint, with_lamps_off
from radcam_depth_ros.simulation.settings.configuration import Season
from radcam_depth_ros.simulation.settings.randomness import pick
from radcam_depth_ros.simulation.settings.style import StreetStyle

_CARS = (VehicleKind.HATCHBACK, VehicleKind.SALOON, VehicleKind.ESTATE, VehicleKind.SUV)
_LARGE = (VehicleKind.VAN, VehicleKind.VAN, VehicleKind.TRUCK, VehicleKind.ARTICULATED, VehicleKind.BUS)

# Shares with something on their flanks, and how bright white print is.
_LETTERED_LARGE, _LETTERED_CARS, _PRINT = 0.6, 0.07, 0.9


@dataclass(frozen=True)
class Library:
    """Prototypes.

    Attributes:
        cars: What also parks along the road.
        large: Vans, trucks and buses.
        cyclists: Bicycles with a rider.
        bicycles: Bicycles that are parked.
        motorcycles: Motorcycles with a rider.
        standing: Motorcycles that are parked.
        animals: One of each kind.
        walkers: People on foot, each in the poses of one double step.
        plants: Several of each kind.
        lettering: Whether something is written on vehicles' flanks.
    """

    cars: tuple[Vehicle, ...]
    large: tuple[Vehicle, ...]
    cyclists: tuple[Mesh, ...]
    bicycles: tuple[Mesh, ...]
    motorcycles: tuple[Vehicle, ...]
    standing: tuple[Vehicle, ...]
    animals: dict[AnimalKind, Mesh]
    walkers: tuple[tuple[Mesh, ...], ...]
    plants: dict[PlantKind, tuple[Plant, ...]]
    lettering: bool = False

    def draw_vehicle(self, rng: np.random.Generator, large: float) -> Vehicle:
        """A vehicle in traffic, of any colour; `large` is the share of vans, trucks and buses."""
        if rng.random() < 0.025:
            return repainted(pick(rng, self.motorcycles), rng)
        return self._draw_closed(rng, large)

    def draw_parked(self, rng: np.random.Generator, large: float = 0.0) -> Vehicle:
        """A parked vehicle of any colour; `large` is the share of vans, trucks and buses."""
        vehicle = repainted(pick(rng, self.standing), rng) if rng.random() < 0.02 else self._draw_closed(rng, large)
        return replace(vehicle, mesh=with_lamps_off(vehicle.mesh))

    def _draw_closed(self, rng: np.random.Generator, large: float) -> Vehicle:
        is_large = rng.random() < large
        share = (_LETTERED_LARGE if is_large else _LETTERED_CARS) * self.lettering
        return repainted(pick(rng, self.large if is_large else self.cars), rng, share)

    def draw_tree(self, rng: np.random.Generator, style: StreetStyle) -> Plant:
        """A tree as the season and the place have them."""
        if rng.random() < style.conifers:
            return pick(rng, self.plants[PlantKind.CONIFER])
        return pick(rng, self.plants[PlantKind.BARE if rng.random() < style.bare else PlantKind.BROADLEAF])

    def draw_bush(self, rng: np.random.Generator, style: StreetStyle) -> Plant:
        """A bush, likewise."""
        return pick(rng, self.plants[PlantKind.BARE_BUSH if rng.random() < style.bare * 0.7 else PlantKind.BUSH])


def repainted(vehicle: Vehicle, rng: np.random.Generator, lettered: float = 0.0) -> Vehicle:
    """The vehicle in another colour, as dirty as it happens to be, with something on its flanks in a share of cases."""
    colour = paint(rng)
    mesh = _lettered(vehicle.mesh.recoloured(Surface.BODYWORK, colour), colour, lettered)
    grime = rng.uniform(0, 0.7) * float(rng.random() < 0.6)
    if grime > 0:
        height = mesh.corners[..., 2].mean(axis=1)
        share = (grime * np.clip(1.3 - height, 0.12, 1.0))[:, None].astype(np.float32)
        mesh = replace(mesh, colour=mesh.colour * (1 - share) + np.float32(rng.uniform(0.06, 0.2)) * share)
    return replace(vehicle, mesh=mesh)


def _lettered(mesh: Mesh, colour: Colour, share: float) -> Mesh:
    """The mesh with a print on the faces that are marked for it, or with those plain."""
    flank = np.isin(mesh.texture, LIVERIES)
    if not flank.any():
        return mesh
    # The paint decides, so that prints take no numbers from what places the vehicles.
    own = np.random.default_rng(int(sum(colour) * 1e9))
    if own.random() >= share:
        plain = np.where(mesh.surface == Surface.CANVAS, np.uint8(Texture.METAL), np.uint8(Texture.PLAIN))
        return replace(mesh, texture=np.where(flank, plain, mesh.texture))
    printed = np.uint8(pick(own, LIVERIES))
    return replace(
        mesh,
        texture=np.where(flank, printed, mesh.texture),
        colour=np.where(flank[:, None], np.float32(_PRINT), mesh.colour),
    )


def build_library(rng: np.random.Generator, style: StreetStyle, lettering: bool = False) -> Library:
    """Builds the prototypes of a world."""
    needles = scaled(style.foliage, 0.55) if style.season is Season.SUMMER else (0.025, 0.042, 0.022)
    colours = {
        PlantKind.BROADLEAF: style.foliage,
        PlantKind.BARE: style.twig,
        PlantKind.CONIFER: needles,
        PlantKind.BUSH: style.foliage,
        PlantKind.BARE_BUSH: style.twig,
    }
    return Library(
        cars=tuple(build_vehicle(rng, kind) for kind in 2 * _CARS),
        large=tuple(build_vehicle(rng, kind) for kind in _LARGE),
        cyclists=tuple(build_bicycle(rng, with_rider=True) for _ in range(3)),
        bicycles=tuple(build_bicycle(rng, with_rider=False) for _ in range(2)),
        motorcycles=tuple(build_motorcycle(rng, with_rider=True) for _ in range(2)),
        standing=tuple(build_motorcycle(rng, with_rider=False) for _ in range(2)),
        animals={kind: build_animal(rng, kind) for kind in AnimalKind},
        walkers=tuple(build_walker(rng) for _ in range(7)),
        plants={kind: tuple(build_plant(rng, kind, colours[kind]) for _ in range(3)) for kind in PlantKind},
        lettering=lettering,
    )
