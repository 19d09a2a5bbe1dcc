"""Finds the fields of a radar's clouds: which field is which quantity, by alias, and in which unit."""

from __future__ import annotations

import dataclasses
import difflib
import math
from dataclasses import dataclass

from radcam_depth_ros.messages.clouds import Cloud, CloudField
from radcam_depth_ros.messages.wire import MessageError

_LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 0.001}
_SPEEDS = {"m/s": 1.0, "cm/s": 0.01, "km/h": 1 / 3.6}
UNITS = {
    **dict.fromkeys(("x", "y", "z", "range"), _LENGTHS),
    **dict.fromkeys(("azimuth", "elevation"), _ANGLES),
    **dict.fromkeys(("radial_speed", "velocity_x", "velocity_y", "velocity_z"), _SPEEDS),
    **dict.fromkeys(("compensated_x", "compensated_y"), _SPEEDS),
}
"""Of each quantity that has some: units by their names, and what a value in one of them is multiplied by."""


@dataclass(frozen=True)
class FieldAliases:
    """By which names a radar's quantities are looked up: the first name that a cloud has is taken, case is ignored.

    Positions are x y (z), metres, x forward, y left, z up; where x or y is missing they come from range, azimuth and
    elevation, radians, azimuth positive to the left, elevation positive up. A missing z or elevation is 0.
    The speed is the field of `radial_speed`, else a cartesian velocity along the line of sight: relative to the sensor
    (`velocity_*`) when given, else compensated for the ego motion (`compensated_*`). A name may end in a unit of
    `UNITS`, `az[deg]`, which `[-deg]` turns the sign of.

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
        "speed",
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
                a cloud has is taken. `QUANTITY=` ignores that quantity. `QUANTITY=FIELD[UNIT]` has another unit than
                metres, radians or m/s; `[-UNIT]` turns the sign. Such as `rcs=power radial_speed=v_d[-km/h],v_r`.

        Raises:
            MessageError: for something else, or a quantity or a unit that there is not.
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
            for name in named[quantity]:
                _scale_of(quantity, _split(name)[1])
        return cls(**named)


DEFAULT_ALIASES = FieldAliases()
"""Names of the drivers that are known."""


@dataclass(frozen=True)
class RadarFields:
    """Which fields of a radar's clouds are read, by their names as published, with their units where these are named.

    Attributes:
        position: x y z, or range, azimuth and elevation; the third is left out where there is none.
        rcs: The radar cross section; empty where there is none.
        radial_speed: The Doppler speed, or the parts of a velocity that it is computed of; empty where there is none.
    """

    position: tuple[str, ...] = ()
    rcs: str = ""
    radial_speed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Column:
    """A field of a cloud that is read.

    Attributes:
        field: The field.
        unit: As it is named; empty where none is.
        scale: What a value is multiplied by to be in metres, radians or m/s.
    """

    field: CloudField
    unit: str = ""
    scale: float = 1.0

    def __str__(self) -> str:
        return f"{self.field.name}[{self.unit}]" if self.unit else self.field.name


@dataclass(frozen=True)
class RadarColumns:
    """The fields of one cloud that are read.

    Attributes:
        is_polar: The position is range, azimuth and elevation, and not x y z.
        position: Three; the last is None where there is none.
        rcs: The radar cross section; None where there is none.
        radial_speed: The Doppler field alone, or three parts of a velocity of which the last may be None; else empty.
        is_over_ground: The speeds are over ground, and not relative to the sensor.
    """

    is_polar: bool
    position: tuple[Column | None, ...]
    rcs: Column | None
    radial_speed: tuple[Column | None, ...]
    is_over_ground: bool

    @classmethod
    def of(cls, cloud: Cloud, aliases: FieldAliases) -> RadarColumns:
        """Looks the fields of a cloud up.

        Raises:
            MessageError: when there is neither x y nor range and azimuth, when a field is missing that is not one of
                the known names, or for a field of an unknown datatype.
        """
        _require_named(cloud, aliases)
        is_polar, position = _position(cloud, aliases)
        return cls(is_polar, position, _find(cloud, aliases, "rcs"), *_radial_speed(cloud, aliases))

    def fields(self, *, has_third: bool = True) -> RadarFields:
        """Their names.

        Args:
            has_third: Whether z or elevation says anything.
        """
        position = self.position if has_third else self.position[:2]
        return RadarFields(
            tuple(str(column) for column in position if column is not None),
            str(self.rcs or ""),
            tuple(str(column) for column in self.radial_speed if column is not None),
        )


def _split(name: str) -> tuple[str, str]:
    """A field's name and its unit, which may be empty."""
    field, bracket, unit = name.partition("[")
    return (field, unit.removesuffix("]")) if bracket and name.endswith("]") else (name, "")


def _scale_of(quantity: str, unit: str) -> float:
    units = UNITS.get(quantity, {})
    if not unit:
        return 1.0
    scale = units.get(unit.removeprefix("-"))
    if scale is None:
        known = f"one of {', '.join(units)}, or with a minus to turn the sign" if units else "none"
        raise MessageError(f"expected as the unit of {quantity} in the radar's fields {known}, got [{unit}]")
    return -scale if unit.startswith("-") else scale


def _find(cloud: Cloud, aliases: FieldAliases, quantity: str) -> Column | None:
    names: tuple[str, ...] = getattr(aliases, quantity)
    units = {field.lower(): unit for field, unit in map(_split, reversed(names))}
    found = cloud.find(_split(name)[0] for name in names)
    if found is None:
        return None
    unit = units[found.name.strip().lower()]
    return Column(found, unit, _scale_of(quantity, unit))


def _require_named(cloud: Cloud, aliases: FieldAliases) -> None:
    """Refuses a cloud without a field that somebody named: without it a quantity would be missing in silence."""
    for entry in dataclasses.fields(aliases) if aliases != DEFAULT_ALIASES else ():
        names = getattr(aliases, entry.name)
        if names and names != getattr(DEFAULT_ALIASES, entry.name) and _find(cloud, aliases, entry.name) is None:
            raise MessageError(
                f"expected a radar cloud with the field {' or '.join(_split(name)[0] for name in names)} for "
                f"{entry.name}, as the field aliases name it, got {cloud.field_names}; name one of these"
            )


def _position(cloud: Cloud, aliases: FieldAliases) -> tuple[bool, tuple[Column | None, ...]]:
    """Whether positions are polar, and their three fields, of which the last may be missing."""
    x, y = _find(cloud, aliases, "x"), _find(cloud, aliases, "y")
    if x is not None and y is not None:
        return False, (x, y, _find(cloud, aliases, "z"))
    distance, azimuth = _find(cloud, aliases, "range"), _find(cloud, aliases, "azimuth")
    if distance is None or azimuth is None:
        raise MessageError(
            f"expected a radar cloud with fields x y z, or dist_x dist_y, or range and azimuth, got "
            f"{cloud.field_names}; choose the radar's point topic, or name its fields in the field aliases"
        )
    return True, (distance, azimuth, _find(cloud, aliases, "elevation"))


def _radial_speed(cloud: Cloud, aliases: FieldAliases) -> tuple[tuple[Column | None, ...], bool]:
    """The fields, see `RadarColumns`, and whether they are over ground."""
    doppler = _find(cloud, aliases, "radial_speed")
    if doppler is not None:
        return (doppler,), False
    # The relative velocity is what the sensor measured along the line of sight; compensation needs an ego motion and
    # is there only where nothing else is.
    velocity = tuple(_find(cloud, aliases, name) for name in ("velocity_x", "velocity_y", "velocity_z"))
    is_over_ground = velocity[0] is None or velocity[1] is None
    if is_over_ground:
        velocity = (_find(cloud, aliases, "compensated_x"), _find(cloud, aliases, "compensated_y"), None)
    return ((), False) if velocity[0] is None or velocity[1] is None else (velocity, is_over_ground)
