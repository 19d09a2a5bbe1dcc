"""Decodes radar point clouds of any driver: fields by alias, cartesian or polar positions, any form of Doppler."""

from __future__ import annotations

import dataclasses
import difflib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from radcam_depth_ros.frame import FloatArray, RadarReturns
from radcam_depth_ros.messages.clouds import Cloud, CloudField
from radcam_depth_ros.messages.wire import LARGEST_M, MessageError, stamp_ns

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
        "mag",
        "magnitude",
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

    @classmethod
    def parse(cls, text: str) -> FieldAliases:
        """The known names, but for quantities that a text names.

        Args:
            text: `QUANTITY=FIELD` for each, with blanks between; of several names, with commas between, the first that
                a cloud has is taken. `QUANTITY=` ignores that quantity. Such as `rcs=power radial_speed=v_d,v_r`.

        Raises:
            MessageError: for something else, or a quantity that there is not.
        """
        known = [entry.name for entry in dataclasses.fields(cls)]
        named: dict[str, tuple[str, ...]] = {}
        for word in text.split():
            quantity, equals, names = word.partition("=")
            if not equals or quantity not in known:
                near = difflib.get_close_matches(quantity, known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"quantities are {', '.join(known)}"
                raise MessageError(f"expected the radar's fields as quantity=field, got {word!r}; {hint}")
            named[quantity] = tuple(name for name in names.split(",") if name)
        return cls(**named)


DEFAULT_ALIASES = FieldAliases()
"""Names of the drivers that are known."""


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
    """

    stamp_ns: int
    frame_id: str
    returns: RadarReturns
    dropped: int
    is_over_ground: bool = False
    thinned: int = 0


@dataclass(frozen=True)
class RadarFields:
    """Which fields of a radar's clouds are read, by their names as published.

    Attributes:
        position: x y z, or range, azimuth and elevation; the third is left out where there is none.
        rcs: The radar cross section; empty where there is none.
        radial_speed: The Doppler speed, or the parts of a velocity that it is computed of; empty where there is none.
    """

    position: tuple[str, ...]
    rcs: str
    radial_speed: tuple[str, ...]


def radar_fields(message: Any, aliases: FieldAliases = DEFAULT_ALIASES) -> RadarFields:
    """Tells which fields `decode_radar` reads of a sensor_msgs/PointCloud2.

    Raises:
        MessageError: when there is neither x y nor range and azimuth, or for a field of an unknown datatype.
    """
    cloud = Cloud(message)
    _, position = _position_fields(cloud, aliases)
    rcs = cloud.find(aliases.rcs)
    return RadarFields(
        tuple(field.name for field in position if field is not None),
        rcs.name if rcs is not None else "",
        tuple(field.name for field in _speed_fields(cloud, aliases)[0] if field is not None),
    )


def decode_radar(message: Any, aliases: FieldAliases = DEFAULT_ALIASES) -> RadarReading:
    """Reads a radar's sensor_msgs/PointCloud2.

    Rows without a finite position are dropped and counted; an RCS or a speed that is missing or not finite is NaN. Of
    more than `MOST_RETURNS` the nearest are kept.

    Args:
        message: The point cloud.
        aliases: Names of its fields.

    Raises:
        MessageError: when there is neither x y nor range and azimuth, when a field is missing that is not one of the
            known names, when angles can't be radians, or when sizes, steps and data don't agree.
    """
    cloud = Cloud(message)
    stamp, frame_id = stamp_ns(message.header), str(message.header.frame_id)
    if not cloud.count:
        return RadarReading(stamp, frame_id, RadarReturns.empty(), 0)
    _require_named(cloud, aliases)
    xyz = _positions(cloud, aliases)
    finite = (np.abs(xyz) < LARGEST_M).all(axis=1)  # NaN is not
    speeds, is_over_ground = _radial_speeds(cloud, aliases, xyz)
    rows = np.flatnonzero(finite)
    kept = _nearest(xyz, rows)
    returns = RadarReturns(
        xyz[kept],
        _finite_or_nan(_cross_sections(cloud, aliases))[kept],
        _finite_or_nan(speeds)[kept],
        np.full(len(kept), np.nan, np.float32),
    )
    return RadarReading(stamp, frame_id, returns, cloud.count - len(rows), is_over_ground, len(rows) - len(kept))


def _nearest(xyz: FloatArray, rows: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """At most `MOST_RETURNS` of some rows, the nearest, in their order."""
    if len(rows) <= MOST_RETURNS:
        return rows
    squared = np.square(xyz[rows], dtype=np.float64).sum(axis=1)
    return np.sort(rows[np.argpartition(squared, MOST_RETURNS)[:MOST_RETURNS]])


def _require_named(cloud: Cloud, aliases: FieldAliases) -> None:
    """Refuses a cloud without a field that somebody named: without it a quantity would be missing in silence."""
    for entry in dataclasses.fields(aliases) if aliases != DEFAULT_ALIASES else ():
        names = getattr(aliases, entry.name)
        if names and names != getattr(DEFAULT_ALIASES, entry.name) and cloud.find(names) is None:
            raise MessageError(
                f"expected a radar cloud with the field {' or '.join(names)} for {entry.name}, as the field aliases "
                f"name it, got {cloud.field_names}; name one of these"
            )


def _position_fields(cloud: Cloud, aliases: FieldAliases) -> tuple[bool, tuple[CloudField | None, ...]]:
    """Whether positions are polar, and their three fields, of which the last may be missing."""
    x, y = cloud.find(aliases.x), cloud.find(aliases.y)
    if x is not None and y is not None:
        return False, (x, y, cloud.find(aliases.z))
    distance, azimuth = cloud.find(aliases.range), cloud.find(aliases.azimuth)
    if distance is None or azimuth is None:
        raise MessageError(
            f"expected a radar cloud with fields x y z, or dist_x dist_y, or range and azimuth, got "
            f"{cloud.field_names}; choose the radar's point topic, or name its fields in the field aliases"
        )
    return True, (distance, azimuth, cloud.find(aliases.elevation))


def _positions(cloud: Cloud, aliases: FieldAliases) -> FloatArray:
    is_polar, fields = _position_fields(cloud, aliases)
    polar = _columns(cloud, *fields)
    if not is_polar:
        return polar
    largest = float(np.max(np.abs(polar[:, 1:]), initial=0.0, where=np.isfinite(polar[:, 1:])))
    if largest > 2 * np.pi:
        name = fields[1].name if fields[1] is not None else ""
        raise MessageError(
            f"expected radar angles in radians in the field {name!r}, got {largest:.1f}; make the driver "
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


def _speed_fields(cloud: Cloud, aliases: FieldAliases) -> tuple[tuple[CloudField | None, ...], bool]:
    """The Doppler field alone, or the three parts of a velocity, of which the last may be missing; else empty.

    And whether they are over ground.
    """
    doppler = cloud.find(aliases.radial_speed)
    if doppler is not None:
        return (doppler,), False
    # The relative velocity is what the sensor measured along the line of sight; compensation needs an ego motion and
    # is there only where nothing else is.
    velocity = (cloud.find(aliases.velocity_x), cloud.find(aliases.velocity_y), cloud.find(aliases.velocity_z))
    is_over_ground = velocity[0] is None or velocity[1] is None
    if is_over_ground:
        velocity = (cloud.find(aliases.compensated_x), cloud.find(aliases.compensated_y), None)
    return ((), False) if velocity[0] is None or velocity[1] is None else (velocity, is_over_ground)


def _radial_speeds(cloud: Cloud, aliases: FieldAliases, xyz: FloatArray) -> tuple[FloatArray, bool]:
    """The speeds, and whether they are over ground."""
    fields, is_over_ground = _speed_fields(cloud, aliases)
    if not fields:
        return np.full(cloud.count, np.nan, np.float32), False
    columns = _columns(cloud, *fields)
    if len(fields) == 1:
        return columns[:, 0], is_over_ground
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        along: FloatArray = (columns * xyz).sum(axis=1) / np.linalg.norm(xyz, axis=1)
    return along, is_over_ground


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
