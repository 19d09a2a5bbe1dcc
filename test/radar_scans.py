"""Radar scans: returns as radar_msgs/RadarScan."""

from __future__ import annotations

from typing import Any

import numpy as np

from radcam_depth_ros.messages import SCAN_FIELDS, MessageFactory
from radcam_depth_ros.messages.wire import make_header

SCAN = "radar_msgs/msg/RadarScan"


def encode_scan(make: MessageFactory, columns: dict[str, Any], stamp_ns: int, frame_id: str) -> Any:
    """A scan of some columns, (N,) each, named as in radar_msgs/RadarReturn; those left out are 0."""
    count = len(next(iter(columns.values()), ()))
    table = np.zeros((count, len(SCAN_FIELDS)), np.float32)
    for name, values in columns.items():
        table[:, SCAN_FIELDS.index(name)] = values
    returns = [
        make("radar_msgs/msg/RadarReturn", **dict(zip(SCAN_FIELDS, map(float, row), strict=True))) for row in table
    ]
    return make(SCAN, header=make_header(make, stamp_ns, frame_id), returns=returns)


def polar(xyz_m: Any) -> dict[str, np.ndarray]:
    """Range, azimuth and elevation of points (N, 3), float32."""
    x, y, z = np.asarray(xyz_m, np.float64).reshape(-1, 3).T
    distance = np.linalg.norm((x, y, z), axis=0)
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    names = ("range", "azimuth", "elevation")
    return {name: values.astype(np.float32) for name, values in zip(names, (distance, azimuth, elevation), strict=True)}
