"""The drives of a run, one by one: names, content, and what is done with each."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol


@dataclass(frozen=True)
class Unit:
    """One drive of a run.

    Attributes:
        place: Where its bag is, as it was given; of a drive that is yet to be simulated its seed.
        name: Name of its files among the results; no two of a run are the same.
    """

    place: str
    name: str

    @property
    def seed(self) -> int:
        """Of a drive that is to be simulated."""
        return int(self.place)


def units_of(places: Sequence[str]) -> tuple[Unit, ...]:
    """The units of some bags or seeds, in this order.

    A bag that moves keeps its name, and so its result; where several have one name, all of them get their place's hash.
    """
    stems = [_stem(place) for place in places]
    taken = Counter(stems)
    pairs = zip(places, stems, strict=True)
    return tuple(Unit(place, stem if taken[stem] == 1 else f"{stem}-{_short(place)}") for place, stem in pairs)


def _stem(place: str) -> str:
    last = place.rstrip("/").rpartition("/")[2]
    stem = re.sub(r"\.(mcap|db3)$", "", last)
    plain = re.sub(r"[^\w-]+", "_", stem, flags=re.ASCII)[:80].strip("_")
    return plain if plain == stem else f"{plain}-{_short(last)}".lstrip("-")


def _short(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:8]


Worker = Callable[[Unit, Path, Path], Mapping[str, Any]]
"""Does one drive: given the unit, its bag on the local disk, and where to write a bag, gives plain values for JSON."""


class Work(Protocol):
    """What is done with each drive; pickled where other processes do it.

    Attributes:
        verb: Of the command line, for sentences.
        suffix: What a unit's own output ends in, `.mcap`; empty where its result is all that it gives.
        reads_bags: Whether units have bags; else they are seeds.
        threads: Cores that a unit keeps busy.
    """

    verb: ClassVar[str]
    suffix: ClassVar[str]
    reads_bags: ClassVar[bool]

    @property
    def threads(self) -> int:
        """Cores that a unit keeps busy."""

    def settings(self) -> dict[str, Any]:
        """Plain values that decide the results: others give other results."""

    def facts(self) -> dict[str, Any]:
        """Plain values to be told with the results, which decide nothing."""

    def open(self) -> Worker:
        """Loads what all units need, once a process."""
