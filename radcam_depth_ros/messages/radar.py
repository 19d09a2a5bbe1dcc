"""Decodes radar sweeps of any driver: fields by alias, cartesian or polar positions, any form of Doppler."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray, RadarReturns
from radcam_depth_ros.messages.clouds import Cloud, CloudField
from radcam_depth_ros.messages.radar_fields import DEFAULT_ALIASES, Column, FieldAliases, RadarColumns, RadarFields
from radcam_depth_ros.messages.radar_scan import radar_cloud
from radcam_depth_ros.messages.wire import LARGEST_M, MessageError, stamp_ns

_LARGEST_RCS_DBSM = 200.0
_SMALLEST_RCS_DBSM = 1e-6
MOST_RETURNS = 20_000
"""Of a sweep: imaging radars give up to some 10,000; a million take seconds and gigabytes."""


@dataclass(frozen=True)
class RadarReading:
    """One sweep of a radar.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The radar's frame; empty where the driver gives none.
        returns: In the radar's frame; their age is not known yet (NaN).
        dropped: Number of returns left out since their position was NaN or infinite.
        is_over_ground: The radial speeds are over ground, and not relative to the sensor.
        thinned: Number of returns left out since there were more than `MOST_RETURNS`; the nearest are kept.
        fields: What they were read from; nothing of a sweep without returns.
    """

    stamp_ns: int
    frame_id: str
    returns: RadarReturns
    dropped: int
    is_over_ground: bool = False
    thinned: int = 0
    fields: RadarFields = field(default_factory=RadarFields)


def decode_radar(message: Any, aliases: FieldAliases = DEFAULT_ALIASES) -> RadarReading:
    """Reads a radar's sensor_msgs/PointCloud2 or radar_msgs/RadarScan.

    Rows without a finite position are dropped and counted; an RCS or a speed that is missing or not finite is NaN. Of
    more than `MOST_RETURNS` the nearest are kept. Where no return of a sweep has a z or an elevation, it is 0.

    Args:
        message: The point cloud, or the scan.
        aliases: Names of its fields.

    Raises:
        MessageError: when there is neither x y nor range and azimuth, when a field is missing that is not one of the
            known names, when angles can't be radians, or when sizes, steps and data don't agree.
    """
    cloud = radar_cloud(message)
    stamp, frame_id = stamp_ns(message.header), str(message.header.frame_id)
    if not cloud.count:
        return RadarReading(stamp, frame_id, RadarReturns.empty(), 0)
    columns = RadarColumns.of(cloud, aliases)
    xyz, has_third = _positions(cloud, columns)
    finite = (np.abs(xyz) < LARGEST_M).all(axis=1)  # NaN is not
    speeds = _radial_speeds(cloud, columns, xyz)
    rows = np.flatnonzero(finite)
    kept = _nearest(xyz, rows)
    returns = RadarReturns(
        xyz[kept],
        _finite_or_nan(_cross_sections(cloud, columns.rcs))[kept],
        _finite_or_nan(speeds)[kept],
        np.full(len(kept), np.nan, np.float32),
    )
    return RadarReading(
        stamp,
        frame_id,
        returns,
        cloud.count - len(rows),
        columns.is_over_ground,
        len(rows) - len(kept),
        columns.fields(has_third=has_third),
    )


def _nearest(xyz: FloatArray, rows: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """At most `MOST_RETURNS` of some rows, the nearest, in their order."""
    if len(rows) <= MOST_RETURNS:
        return rows
    squared = np.square(xyz[rows], dtype=np.float64).sum(axis=1)
    return np.sort(rows[np.argpartition(squared, MOST_RETURNS)[:MOST_RETURNS]])


def _positions(cloud: Cloud, columns: RadarColumns) -> tuple[FloatArray, bool]:
    """(N, 3) metres, and whether any return has a z or an elevation: it is 0 where none has."""
    values = _values(cloud, *columns.position)
    has_third = columns.position[2] is not None and not np.isnan(values[:, 2]).all()
    if not has_third:
        values[:, 2] = 0.0
    if not columns.is_polar:
        return values, has_third
    for index, quantity in ((1, "azimuth"), (2, "elevation")):
        _check_angles(quantity, values[:, index], columns.position[index])
    with np.errstate(invalid="ignore", over="ignore"):
        on_plane = values[:, 0] * np.cos(values[:, 2])
        rows = (on_plane * np.cos(values[:, 1]), on_plane * np.sin(values[:, 1]), values[:, 0] * np.sin(values[:, 2]))
        return np.stack(rows, axis=1), has_third


def _check_angles(quantity: str, angles: FloatArray, column: Column | None) -> None:
    largest = float(np.max(np.abs(angles), initial=0.0, where=np.isfinite(angles)))
    if column is None or largest <= 2 * np.pi:
        return
    name = column.field.name
    if column.unit:
        raise MessageError(
            f"expected angles within a full turn in the field {name!r}, got {largest / abs(column.scale):.1f} "
            f"{column.unit.removeprefix('-')}; see which unit the driver has, and name it in the field aliases"
        )
    raise MessageError(
        f"expected radar angles in radians in the field {name!r}, got {largest:.1f}; if they are degrees, set the "
        f"parameter radar_fields to {quantity}={name}[deg], or make the driver publish radians or x y z"
    )


def _values(cloud: Cloud, *columns: Column | None) -> FloatArray:
    """The fields side by side in metres, radians or m/s, (N, fields) float32; 0 where there is no such field."""
    values = np.zeros((cloud.count, len(columns)), np.float32)
    for index, column in enumerate(columns):
        if column is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # a NaN that signals, too
                values[:, index] = cloud.floats(column.field) * np.float32(column.scale)
    return values


def _radial_speeds(cloud: Cloud, columns: RadarColumns, xyz: FloatArray) -> FloatArray:
    if not columns.radial_speed:
        return np.full(cloud.count, np.nan, np.float32)
    values = _values(cloud, *columns.radial_speed)
    if len(columns.radial_speed) == 1:
        return values[:, 0]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        along: FloatArray = (values * xyz).sum(axis=1) / np.linalg.norm(xyz, axis=1)
    return along


def _cross_sections(cloud: Cloud, column: Column | None) -> FloatArray:
    if column is None:
        return np.full(cloud.count, np.nan, np.float32)
    return (_mislabelled_floats if column.field.type_code == "u1" else Cloud.floats)(cloud, column.field)


def _mislabelled_floats(cloud: Cloud, field: CloudField) -> FloatArray:
    """A cross section declared as uint8, read as float32 where that is what the bytes are.

    Nebula's SRR520 driver declares `rcs` as uint8 and stores a float32. The declaration is overruled only when it has
    to be wrong: four bytes are free for the field, and every value read as float32 is 0 or has a plausible size. A true
    uint8 followed by zero padding fails the second test: as float32 it is below 1e-40.
    """
    declared = cloud.floats(field)
    next_field = min([int(other.offset) for other in cloud.fields if int(other.offset) > field.offset], default=None)
    free = (cloud.point_step if next_field is None else next_field) - field.offset
    if free < np.dtype(np.float32).itemsize:
        return declared
    stored = cloud.floats(CloudField(field.name, "f4", field.offset))
    known = np.abs(stored[~np.isnan(stored)])
    plausible = (known == 0) | ((known > _SMALLEST_RCS_DBSM) & (known < _LARGEST_RCS_DBSM))
    return stored if known.size and bool(plausible.all()) else declared


def _finite_or_nan(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.float32(np.nan))
