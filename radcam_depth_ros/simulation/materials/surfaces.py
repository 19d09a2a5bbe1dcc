"""Materials: classes, surfaces and textures, and how each sensor sees a surface."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from radcam_depth_ros.frame import FloatArray

Colour = tuple[float, float, float]
"""Linear RGB."""


class Label(IntEnum):
    """What the class image holds: Cityscapes' train ids, and two values that are no class of Cityscapes."""

    ROAD = 0
    SIDEWALK = 1
    BUILDING = 2
    WALL = 3
    FENCE = 4
    POLE = 5
    TRAFFIC_LIGHT = 6
    TRAFFIC_SIGN = 7
    VEGETATION = 8
    TERRAIN = 9
    SKY = 10
    PERSON = 11
    RIDER = 12
    CAR = 13
    TRUCK = 14
    BUS = 15
    TRAIN = 16
    MOTORCYCLE = 17
    BICYCLE = 18
    WIRE = 254
    IGNORE = 255


class Surface(IntEnum):
    """Kinds of surface; each has a row in the table below."""

    ASPHALT = 0
    PAINT_MARK = 1
    PAVING = 2
    GROUND = 3
    MASONRY = 4
    ROOF = 5
    FOLIAGE = 6
    WOOD = 7
    METAL = 8
    SIGN_FACE = 9
    BODYWORK = 10
    GLASS = 11
    RUBBER = 12
    LAMP = 13
    CLOTH = 14
    CANVAS = 15


class Texture(IntEnum):
    """Tiles of the texture atlas; PLAIN is white."""

    PLAIN = 0
    ASPHALT = 1
    ASPHALT_PATCHED = 2
    MARK = 3
    PAVING = 4
    COBBLES = 5
    GRASS = 6
    SOIL = 7
    SNOW = 8
    LEAF = 9
    BARK = 10
    CLOTH = 11
    ROOF = 12
    METAL = 13
    PLANKS = 14
    HEDGE = 15
    SIGN = 16
    FACADE_0 = 17
    FACADE_1 = 18
    FACADE_2 = 19
    FACADE_3 = 20
    FACADE_4 = 21
    FACADE_5 = 22
    SHOP = 23
    GRILLE = 24
    ASPHALT_WORN = 25
    CONCRETE = 26
    GRAVEL = 27
    LITTER = 28
    STRIPES = 29
    BRICK = 30
    LIVERY_0 = 31
    LIVERY_1 = 32
    LIVERY_2 = 33
    LIVERY_3 = 34
    POSTER = 35


FACADES = tuple(texture for texture in Texture if texture.name.startswith("FACADE"))

LIVERIES = tuple(texture for texture in Texture if texture.name.startswith("LIVERY"))
"""What is written and painted on the flanks of vehicles."""


@dataclass(frozen=True)
class SurfaceTable:
    """How each `Surface` looks to the sensors, as columns indexed by its value.

    Attributes:
        gloss: (S,) float32, share of the mirror reflection, 0 to 1, before Fresnel.
        radar_db: (S,) float32, radar reflectivity at normal incidence, dB of cross section per square metre.
        radar_diffuse_db: (S,) float32, the same at grazing incidence: roughness and corners send something back.
        lidar: (S,) float32, reflectivity at 905 nm of the uncoloured material, 0 to 1.
    """

    gloss: FloatArray
    radar_db: FloatArray
    radar_diffuse_db: FloatArray
    lidar: FloatArray


# gloss, radar at normal incidence, radar at grazing incidence, lidar
_ROWS: dict[Surface, tuple[float, float, float, float]] = {
    Surface.ASPHALT: (0.0, -8.0, -38.0, 0.12),
    Surface.PAINT_MARK: (0.05, -8.0, -38.0, 0.6),
    Surface.PAVING: (0.0, -6.0, -32.0, 0.25),
    Surface.GROUND: (0.0, -12.0, -27.0, 0.35),
    Surface.MASONRY: (0.9, 4.0, -16.0, 0.45),
    Surface.ROOF: (0.05, 0.0, -18.0, 0.3),
    Surface.FOLIAGE: (0.03, -13.0, -17.0, 0.45),
    Surface.WOOD: (0.02, -4.0, -12.0, 0.3),
    Surface.METAL: (0.25, 8.0, -4.0, 0.4),
    Surface.SIGN_FACE: (0.15, 10.0, -8.0, 1.0),
    Surface.BODYWORK: (0.7, 12.0, -4.0, 0.4),
    Surface.GLASS: (0.95, -2.0, -14.0, 0.05),
    Surface.RUBBER: (0.03, -4.0, -10.0, 0.06),
    Surface.LAMP: (0.5, 4.0, -6.0, 0.9),
    Surface.CLOTH: (0.0, -6.0, -10.0, 0.4),
    Surface.CANVAS: (0.12, 6.0, -8.0, 0.5),
}


def surface_table() -> SurfaceTable:
    """The columns of all surfaces."""
    rows = np.array([_ROWS[surface] for surface in Surface], np.float32)
    return SurfaceTable(*(np.ascontiguousarray(rows[:, column]) for column in range(rows.shape[1])))


@dataclass(frozen=True)
class Material:
    """The look of a face.

    Attributes:
        surface: What it is made of.
        label: Its class in the ground truth.
        colour: Linear RGB that multiplies the texture.
        texture: Tile of the atlas.
        tile_m: Metres that one tile of the texture covers.
    """

    surface: Surface
    label: Label
    colour: Colour = (1.0, 1.0, 1.0)
    texture: Texture = Texture.PLAIN
    tile_m: float = 1.0


def scaled(colour: Colour, share: float) -> Colour:
    """A colour made darker or brighter."""
    red, green, blue = colour
    return share * red, share * green, share * blue
