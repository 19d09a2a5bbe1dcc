"""Builds and paints vehicles of each kind; each is a mesh about the middle of its footprint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Colour, Surface
from radcam_depth_ros.simulation.objects.cars import build_car
from radcam_depth_ros.simulation.objects.lorries import build_bus, build_truck, build_van
from radcam_depth_ros.simulation.objects.mesh import Mesh
from radcam_depth_ros.simulation.objects.vehicle_parts import Vehicle, VehicleKind
from radcam_depth_ros.simulation.settings.randomness import pick

# Linear RGB and how common it is: most vehicles are black, grey or white.
_PAINTS: tuple[tuple[Colour, float], ...] = (
    ((0.012, 0.013, 0.016), 0.20),
    ((0.035, 0.036, 0.04), 0.14),
    ((0.10, 0.10, 0.11), 0.12),
    ((0.28, 0.29, 0.31), 0.10),
    ((0.50, 0.50, 0.52), 0.10),
    ((0.75, 0.75, 0.74), 0.15),
    ((0.02, 0.035, 0.10), 0.06),
    ((0.03, 0.10, 0.32), 0.04),
    ((0.30, 0.015, 0.015), 0.04),
    ((0.05, 0.07, 0.05), 0.02),
    ((0.22, 0.17, 0.12), 0.02),
    ((0.60, 0.36, 0.03), 0.01),
)


def build_vehicle(rng: np.random.Generator, kind: VehicleKind) -> Vehicle:
    """A vehicle of a kind, with its own proportions."""
    if kind is VehicleKind.VAN:
        return build_van(rng)
    if kind in (VehicleKind.TRUCK, VehicleKind.ARTICULATED):
        return build_truck(rng, articulated=kind is VehicleKind.ARTICULATED)
    if kind is VehicleKind.BUS:
        return build_bus(rng)
    return build_car(rng, kind)


def paint(rng: np.random.Generator) -> Colour:
    """A colour of bodywork."""
    shares = np.array([share for _, share in _PAINTS])
    r, g, b = np.array(pick(rng, _PAINTS, shares)[0]) * rng.uniform(0.75, 1.25)
    return float(r), float(g), float(b)


def with_lamps_off(mesh: Mesh) -> Mesh:
    """The vehicle as it stands parked."""
    return replace(mesh, surface=np.where(mesh.surface == Surface.LAMP, np.uint8(Surface.GLASS), mesh.surface))
