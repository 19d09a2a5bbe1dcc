"""Writes point files as nuScenes has them: binary PCD of a radar, rows of float32 of a LiDAR."""

from __future__ import annotations

from typing import Any

import numpy as np

from radcam_depth_ros.datasets.clouds import Columns
from radcam_depth_ros.messages.clouds import Cloud

_TYPES = {"f": "F", "i": "I", "u": "U"}
_LIDAR = ("x", "y", "z", "intensity", "ring")


def lidar_file(message: Any) -> bytes:
    """float32 x y z intensity ring, point by point, of a sensor_msgs/PointCloud2; 0 for a field that it lacks."""
    cloud = Cloud(message)
    found = [cloud.find((name,)) for name in _LIDAR]
    values = [np.zeros(cloud.count, np.float32) if field is None else cloud.floats(field) for field in found]
    return np.stack(values, axis=1).astype("<f4").tobytes()


def radar_file(message: Any) -> bytes:
    """A binary PCD of a sensor_msgs/PointCloud2's own fields, see `pcd_file`."""
    cloud = Cloud(message)
    found = [cloud.find((str(field.name),)) for field in cloud.fields]
    return pcd_file({field.name: cloud.column(field) for field in found if field is not None})


def pcd_file(columns: Columns) -> bytes:
    """A binary PCD of columns (N,).

    Of no point it has one that is NaN, and a byte follows the last point: nuScenes' files and its devkit want both.
    """
    kinds = {name: column.dtype.newbyteorder("<") for name, column in columns.items()}
    count = len(next(iter(columns.values())))
    points = np.zeros(max(count, 1), np.dtype(list(kinds.items())))
    for name, column in columns.items():
        if count:
            points[name] = column
        elif kinds[name].kind == "f":
            points[name] = np.nan
    lines = (
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(columns)}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in kinds.values())}",
        f"TYPE {' '.join(_TYPES[kind.kind] for kind in kinds.values())}",
        f"COUNT {' '.join('1' for _ in columns)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        "DATA binary",
    )
    return "".join(f"{line}\n" for line in lines).encode() + points.tobytes() + b"\0"
