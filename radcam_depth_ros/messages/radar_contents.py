"""What a radar's clouds have: which field is taken for which quantity, and whether Doppler and RCS say anything."""

from __future__ import annotations

import numpy as np

from radcam_depth_ros.frame import FloatArray, RadarReturns
from radcam_depth_ros.messages.doppler_evidence import DopplerEvidence
from radcam_depth_ros.messages.radar_fields import DEFAULT_ALIASES, FieldAliases, RadarFields

_ENOUGH_RETURNS = 50
"""Before so many returns came, it is not said that a value is constant."""
_INTENSITY = "intensity"
NONE = "none"
"""In place of a field, where there is none."""


class _Quantity:
    """The values of one quantity so far.

    Args:
        name: What it is called, in words.
        alias: What `radar_fields` calls it.
        hint: When one value in all returns is right; empty for never.
    """

    def __init__(self, name: str, alias: str, hint: str = "") -> None:
        self._name, self._alias, self._hint = name, alias, hint
        self.field = NONE
        self._returns, self._varies = 0, False
        self._value: float | None = None

    def add(self, field: str, values: FloatArray) -> None:
        """Takes the values of a sweep, (N,), and the field that they were read from."""
        if field != self.field:
            self.field = field
            self._returns, self._varies, self._value = 0, False, None
        self._returns += len(values)
        known = values[~np.isnan(values)]
        if len(known) and not self._varies:
            self._value = float(known[0]) if self._value is None else self._value
            self._varies = bool((known != np.float32(self._value)).any())

    def problem(self, topic: str) -> str:
        """What is wrong with it on a topic; empty where nothing is, or not enough came to tell."""
        naming = f"name its field by the parameter radar_fields ({self._alias}=FIELD)"
        if not self._returns or self._varies:
            return ""
        if self.field == NONE:
            found = "found no field for it"
            remedy = f"{naming}, or say that there is none ({self._alias}=)"
        elif self._value is None:
            found = f"got no number in the field {self.field} in {self._returns} returns"
            remedy = f"look at the driver, or {naming}"
        elif self._returns >= _ENOUGH_RETURNS:
            found = f"got {self._value:g} in the field {self.field} in all of {self._returns} returns"
            remedy = f"{self._hint}look at the driver, or {naming}"
        else:
            return ""
        return f"expected {self._name} in the returns on {topic}, {found}: {remedy}"


class RadarContents:
    """Notes what the sweeps of one radar have.

    Args:
        aliases: By which names its fields are looked up; what these say not to read is not missed.
    """

    def __init__(self, aliases: FieldAliases) -> None:
        self._position: tuple[str, ...] = ()
        self._doppler = _Quantity("a Doppler speed", "radial_speed", "while nothing moves that is right, else ")
        self._rcs = _Quantity("an RCS", "rcs")
        self._wanted = [
            quantity for quantity, names in ((self._doppler, aliases.radial_speed), (self._rcs, aliases.rcs)) if names
        ]
        self._is_rcs_named = aliases.rcs != DEFAULT_ALIASES.rcs
        self._evidence = DopplerEvidence()

    def add(self, returns: RadarReturns, fields: RadarFields) -> None:
        """Takes a sweep.

        Args:
            returns: Its returns.
            fields: Which fields they were read from.
        """
        if not len(returns):
            return
        self._position = fields.position
        self._doppler.add(" ".join(fields.radial_speed) or NONE, returns.radial_speed_mps)
        self._rcs.add(fields.rcs or NONE, returns.rcs_dbsm)
        if self._is_guessed:
            self._evidence.add(returns)

    @property
    def _is_guessed(self) -> bool:
        """Whether the RCS is an intensity, and nothing says that it is no Doppler speed."""
        is_intensity = self._rcs.field.strip().lower() == _INTENSITY
        return is_intensity and self._doppler.field == NONE and not self._is_rcs_named

    def values(self) -> tuple[tuple[str, str], ...]:
        """Which field is which quantity, as diagnostics values; empty before the first return."""
        if not self._position:
            return ()
        return (
            ("field of the position", " ".join(self._position)),
            ("field of the Doppler speed", self._doppler.field),
            ("field of the RCS", self._rcs.field),
        )

    def summary(self) -> str:
        """The same in a clause; empty before the first return."""
        return ", ".join(f"{name.removeprefix('field of the ')} from {field}" for name, field in self.values())

    def doubt(self, topic: str) -> str:
        """Why an intensity that is taken for the RCS on a topic is likely the Doppler speed; empty where it is not."""
        if not self._is_guessed or not self._evidence.is_strong:
            return ""
        field = self._rcs.field
        return (
            f"expected an RCS in the field {field} on {topic}, for which it was taken, got values that fit the Doppler "
            f"of a moving vehicle in {self._evidence.fitting} of {self._evidence.sweeps} sweeps: set the parameter "
            f"radar_fields to radial_speed={field} rcs= if they are speeds, else to rcs={field} radial_speed="
        )

    def problem(self, topic: str) -> str:
        """What is missing or doubtful in a radar's messages on a topic, or is the same in all returns; else empty.

        Doppler or RCS that differed once is never said to be constant, so that a vehicle that waits gives no warning.
        """
        return self.doubt(topic) or "; ".join(filter(None, (quantity.problem(topic) for quantity in self._wanted)))
