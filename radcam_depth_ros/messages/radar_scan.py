"""Reads a radar's radar_msgs/RadarScan as a cloud whose fields are those of its returns."""

from __future__ import annotations

import sys
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

import numpy as np

from radcam_depth_ros.messages.clouds import Cloud
from radcam_depth_ros.messages.wire import require_fields

SCAN_FIELDS = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
"""Of a radar_msgs/RadarReturn, float32 each: metres, radians, radians, m/s, dB."""
_FLOAT32 = 7  # in sensor_msgs/PointField
_BYTES = 4


def radar_cloud(message: Any) -> Cloud:
    """The returns in a radar's message, a sensor_msgs/PointCloud2 or a radar_msgs/RadarScan, column by column.

    Raises:
        MessageError: for a message of neither type, or one whose sizes don't agree.
    """
    return Cloud(_packed(message) if hasattr(message, "returns") else message)


def _packed(scan: Any) -> Any:
    """A RadarScan with the attributes of a PointCloud2."""
    require_fields(scan, "radar_msgs/RadarScan", "header", "returns")
    returns = scan.returns
    for item in returns[:1]:
        require_fields(item, "radar_msgs/RadarReturn", *SCAN_FIELDS)
    count, size = len(returns), len(SCAN_FIELDS)
    values = np.empty((count, size), np.float32)
    for index, name in enumerate(SCAN_FIELDS):
        values[:, index] = np.fromiter(map(attrgetter(name), returns), np.float32, count)
    fields = [
        SimpleNamespace(name=name, offset=_BYTES * index, datatype=_FLOAT32, count=1)
        for index, name in enumerate(SCAN_FIELDS)
    ]
    return SimpleNamespace(
        header=scan.header,
        height=1,
        width=count,
        fields=fields,
        is_bigendian=sys.byteorder == "big",
        point_step=_BYTES * size,
        row_step=_BYTES * size * count,
        data=values.reshape(-1).view(np.uint8),
    )
