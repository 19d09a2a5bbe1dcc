"""The 19 classes of Cityscapes ([Cordts2016]), and the three parts of a driving scene that they make."""

from __future__ import annotations

CLASS_NAMES = (
    *(
        "road",
        "sidewalk",
        "building",
        "wall",
        "fence",
        "pole",
        "traffic light",
        "traffic sign",
        "vegetation",
        "terrain",
    ),
    *("sky", "person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle"),
)
"""In the order of their training ids."""

WIRE = 254
"""Value of overhead wires in class images of the simulator; no class of Cityscapes."""

ROAD_GROUP = "road, people and vehicles"
"""What a driver looks at."""

CLASS_GROUPS = {
    "sky": ("sky",),
    "trees and buildings": (
        "building",
        "wall",
        "fence",
        "pole",
        "traffic light",
        "traffic sign",
        "vegetation",
    ),
    ROAD_GROUP: (
        *("road", "sidewalk", "terrain", "person", "rider"),
        *("car", "truck", "bus", "train", "motorcycle", "bicycle"),
    ),
}
"""The three categories of a driving scene ([Li2023], section 3), made of the 19 classes by what is like what."""

GROUP_OF_CLASS = tuple(
    next(index for index, group in enumerate(CLASS_GROUPS.values()) if name in group) for name in CLASS_NAMES
)
"""Which of the groups a class belongs to, counted from 0, by its training id."""
