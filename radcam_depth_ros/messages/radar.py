"""Reading radar point clouds of any driver: fields by alias, cartesian or polar positions, any form of Doppler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from radcam_depth_ros.frame import FloatArray, RadarReturns
from radcam_depth_ros.messages.clouds import Cloud, CloudField
from radcam_depth_ros.messages.wire import MessageError, stamp_ns

_LARGEST_RCS_DBSM = 200.0
_SMALLEST_RCS_DBSM = 1e-6


@dataclass(frozen=True)
class FieldAliases:
    """By which names a radar's quantities are looked up: the first name that a cloud has is taken, case is ignored.

    Positions are x y (z), metres, x forward, y left, z up; where x or y is missing they come from range, azimuth and
    elevation, radians, azimuth positive to the left, elevation positive up. A missing z or elevation is 0.
    The speed is the field of `radial_speed`, else a cartesian velocity along the line of sight: relative to the sensor
    (`velocity_*`) when given, else compensated for the ego motion (`compensated_*`).

    Attributes:
        x: Forward, metres.
        y: Left, metres.
        z: Up, metres.
        range: Distance, metres.
        azimuth: Radians.
        elevation: Radians.
        rcs: Radar cross section in dBsm, or what the sensor has of the kind. Empty: ignore it.
        radial_speed: Doppler, m/s, positive moving away. A cloud whose `intensity` is Doppler: ("intensity",).
        velocity_x: Relative velocity, m/s.
        velocity_y: Relative velocity, m/s.
        velocity_z: Relative velocity, m/s.
        compensated_x: Velocity over ground, m/s.
        compensated_y: Velocity over ground, m/s.
    """

    x: tuple[str, ...] = ("x", "dist_x", "distance_x", "dist_long")
    y: tuple[str, ...] = ("y", "dist_y", "distance_y", "dist_lat")
    z: tuple[str, ...] = ("z", "dist_z", "distance_z")
    range: tuple[str, ...] = ("range", "r", "distance", "dist", "radius")
    azimuth: tuple[str, ...] = ("azimuth", "azimuth_angle", "azimuth_rad")
    elevation: tuple[str, ...] = ("elevation", "elevation_angle", "elevation_rad")
    rcs: tuple[str, ...] = (
        "rcs",
        "rcs_dbsm",
        "radar_cross_section",
        "intensity",
        "amplitude",
        "power",
        "snr",
        "snr_db",
    )
    radial_speed: tuple[str, ...] = (
        "radial_speed",
        "radial_velocity",
        "range_rate",
        "doppler",
        "doppler_velocity",
        "v_doppler_mps",
        "velocity",
        "v",
        "v_r",
        "vr",
    )
    velocity_x: tuple[str, ...] = ("vx", "vrel_x", "v_x", "velocity_x", "vrel_long")
    velocity_y: tuple[str, ...] = ("vy", "vrel_y", "v_y", "velocity_y", "vrel_lat")
    velocity_z: tuple[str, ...] = ("vz", "vrel_z", "v_z", "velocity_z")
    compensated_x: tuple[str, ...] = ("vx_comp", "vx_compensated")
    compensated_y: tuple[str, ...] = ("vy_comp", "vy_compensated")


DEFAULT_ALIASES = FieldAliases()
"""Names of the drivers that are known."""


@dataclass(frozen=True)
class RadarReading:
    """One sweep of a radar.

    Attributes:
        stamp_ns: Nanoseconds.
        frame_id: The radar's frame; empty where the driver gives none.
        returns: In the radar's frame; their age is not known yet (NaN).
        dropped: Number of returns left out since their position was NaN or infinite.
    """

    stamp_ns: int
    frame_id: str
    returns: RadarReturns
    dropped: int


def decode_radar(message: Any, aliases: FieldAliases = DEFAULT_ALIASES) -> RadarReading:
    """Reads a radar's sensor_msgs/PointCloud2.

    Rows without a finite position are dropped and counted; an RCS or a speed that is missing or not finite is NaN.

    Args:
        message: The point cloud.
        aliases: Names of its fields.

    Raises:
        MessageError: when there is neither x y nor range and azimuth, when angles can't be radians, or when sizes,
            steps and data don't agree.
    """
    cloud = Cloud(message)
    stamp, frame_id = stamp_ns(message.header), str(message.header.frame_id)
    if not cloud.count:
        return RadarReading(stamp, frame_id, RadarReturns.empty(), 0)
    xyz = _positions(cloud, aliases)
    finite = np.isfinite(xyz).all(axis=1)
    returns = RadarReturns(
        xyz[finite],
        _finite_or_nan(_cross_sections(cloud, aliases))[finite],
        _finite_or_nan(_radial_speeds(cloud, aliases, xyz))[finite],
        np.full(int(finite.sum()), np.nan, np.float32),
    )
    return RadarReading(stamp, frame_id, returns, cloud.count - len(returns))


def _positions(cloud: Cloud, aliases: FieldAliases) -> FloatArray:
    x, y, z = cloud.find(aliases.x), cloud.find(aliases.y), cloud.find(aliases.z)
    if x is not None and y is not None:
        return _columns(cloud, x, y, z)
    distance, azimuth = cloud.find(aliases.range), cloud.find(aliases.azimuth)
    if distance is None or azimuth is None:
        raise MessageError(
            f"expected a radar cloud with fields x y z, or dist_x dist_y, or range and azimuth, got "
            f"{cloud.field_names}; choose the radar's point topic, or name its fields in the field aliases"
        )
    elevation = cloud.find(aliases.elevation)
    polar = _columns(cloud, distance, azimuth, elevation)
    largest = float(np.max(np.abs(polar[:, 1:]), initial=0.0, where=np.isfinite(polar[:, 1:])))
    if largest > 2 * np.pi:
        raise MessageError(
            f"expected radar angles in radians in the field {azimuth.name!r}, got {largest:.1f}; make the driver "
            "publish radians or x y z"
        )
    with np.errstate(invalid="ignore", over="ignore"):
        on_plane = polar[:, 0] * np.cos(polar[:, 2])
        rows = (on_plane * np.cos(polar[:, 1]), on_plane * np.sin(polar[:, 1]), polar[:, 0] * np.sin(polar[:, 2]))
        return np.stack(rows, axis=1)


def _columns(cloud: Cloud, *fields: CloudField | None) -> FloatArray:
    """The fields side by side, (N, fields) float32; 0 where there is no such field."""
    columns = np.zeros((cloud.count, len(fields)), np.float32)
    for index, field in enumerate(fields):
        if field is not None:
            columns[:, index] = cloud.floats(field)
    return columns


def _radial_speeds(cloud: Cloud, aliases: FieldAliases, xyz: FloatArray) -> FloatArray:
    doppler = cloud.find(aliases.radial_speed)
    if doppler is not None:
        return cloud.floats(doppler)
    # The relative velocity is what the sensor measured along the line of sight; compensation needs an ego motion and
    # is there only where nothing else is.
    velocity = (cloud.find(aliases.velocity_x), cloud.find(aliases.velocity_y), cloud.find(aliases.velocity_z))
    if velocity[0] is None or velocity[1] is None:
        velocity = (cloud.find(aliases.compensated_x), cloud.find(aliases.compensated_y), None)
    if velocity[0] is None or velocity[1] is None:
        return np.full(cloud.count, np.nan, np.float32)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        along: FloatArray = (_columns(cloud, *velocity) * xyz).sum(axis=1) / np.linalg.norm(xyz, axis=1)
    return along


def _cross_sections(cloud: Cloud, aliases: FieldAliases) -> FloatArray:
    field = cloud.find(aliases.rcs)
    if field is None:
        return np.full(cloud.count, np.nan, np.float32)
    return _mislabelled_floats(cloud, field) if field.type_code == "u1" else cloud.floats(field)


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
