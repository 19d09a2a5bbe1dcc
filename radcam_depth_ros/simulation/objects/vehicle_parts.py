"""Parts of vehicles: wheels, lamps and glass."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from radcam_depth_ros.simulation.materials.surfaces import Label, Material, Surface, Texture
from radcam_depth_ros.simulation.objects.mesh import Mesh, box, revolved, tube


class VehicleKind(IntEnum):
    """Kinds of vehicle."""

    HATCHBACK = 0
    SALOON = 1
    ESTATE = 2
    SUV = 3
    VAN = 4
    TRUCK = 5
    ARTICULATED = 6
    BUS = 7


@dataclass(frozen=True)
class Vehicle:
    """One prototype; its bodywork is repainted for each vehicle.

    Attributes:
        mesh: Front towards +x, wheels on z = 0.
        length_m: Bumper to bumper.
    """

    mesh: Mesh
    length_m: float


def glass(label: Label) -> Material:
    """Dark glass."""
    return Material(Surface.GLASS, label, (0.015, 0.018, 0.02))


def wheels(label: Label, positions_x: tuple[float, ...], track: float, radius: float) -> list[Mesh]:
    """Wheels on both sides at places along x; `track` is the width of the vehicle."""
    tyre = Material(Surface.RUBBER, label, (0.02, 0.02, 0.022))
    rim = Material(Surface.METAL, label, (0.35, 0.35, 0.37), Texture.GRILLE, radius)
    hub = revolved([[radius * 0.62, 0.225], [0.0, 0.24]], rim, 8)
    upright = [tube(radius, 0.22, tyre, 12), hub]
    # Laid on their side, open end towards the vehicle.
    turned = [part.with_axes(0, 2, 1) for part in upright]
    wheels = []
    for x in positions_x:
        for side in (-1.0, 1.0):
            yaw = 0.0 if side > 0 else np.pi
            wheels += [part.moved((x, side * (track / 2 - 0.2), radius), yaw) for part in turned]
    return wheels


def lamps(label: Label, front_x: float, rear_x: float, half_width: float, height: float, size: float) -> list[Mesh]:
    """Head lamps, tail lamps and number plates; `size` widens or heightens them."""
    white = Material(Surface.LAMP, label, (0.8, 0.8, 0.75))
    red = Material(Surface.LAMP, label, (0.45, 0.015, 0.01))
    parts = []
    for side in (-1, 1):
        y = side * (half_width - 0.24)
        parts.append(box([0.12, 0.3, 0.11 * size], [front_x - 0.08, y - side * 0.04, height - 0.03], white))
        parts.append(box([0.1, 0.22 if size < 1.2 else 0.14, 0.17 * size], [rear_x + 0.03, y, height + 0.1], red))
    plate = Material(Surface.SIGN_FACE, label, (0.7, 0.7, 0.66))
    parts.append(box([0.03, 0.5, 0.11], [rear_x - 0.005, 0, height - 0.12], plate))
    parts.append(box([0.03, 0.5, 0.11], [front_x + 0.005, 0, height - 0.22], plate))
    return parts
