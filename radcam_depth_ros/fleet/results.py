"""The results of a run in a folder: a plan, one file a drive, and the drives that failed.

- `plan.json`: what was asked for, and of which drives; results of other settings are refused.
- `drives/NAME.KEY.json.gz`: a drive's result, named by a key of its content, size, settings and this version. It is
  written last and whole, so a drive is done when it is there.
- `failed/NAME.json` and `failed.jsonl`, all of these one a line: drives that failed, with the reason in one sentence.
"""

from __future__ import annotations

import fcntl
import gzip
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from radcam_depth_ros import __version__
from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.unit import Unit, Work
from radcam_depth_ros.storage import Folder, folder_at

FORMAT_VERSION = 1
"""Counts changes of what results hold."""
PLAN, FAILED = "plan.json", "failed.jsonl"
_DRIVES, _FAILURES, _ENDING = "drives", "failed", ".json.gz"


@dataclass(frozen=True)
class Plan:
    """What a folder's results are of.

    Attributes:
        verb: That made them.
        version: Of this package and of the results' form.
        settings: Plain values that decide the results.
        facts: Plain values that are told with them.
        drives: Places of the drives, in the order of their sums.
    """

    verb: str
    version: str
    settings: Mapping[str, Any]
    facts: Mapping[str, Any]
    drives: tuple[str, ...]

    @classmethod
    def of(cls, work: Work, units: Iterable[Unit]) -> Plan:
        """The plan of a run."""
        # By way of JSON, so that it equals one that was read.
        settings, facts = json.loads(json.dumps([work.settings(), work.facts()]))
        drives = tuple(unit.place for unit in units)
        return cls(work.verb, f"{__version__}, form {FORMAT_VERSION}", settings, facts, drives)

    @property
    def key(self) -> str:
        """Of all that decides the results."""
        return _sha256([self.verb, self.version, self.settings])


@dataclass(frozen=True)
class Header:
    """First line of a result: which drive it is of, and what it took.

    Attributes:
        place: Where the drive's bag was.
        key: See `Results`.
        stamp: Size and time of change of the bag, or its etag: while it is the same, nobody reads the bag to know it.
        content: SHA-256 of the bag, or its etag.
        output: The bag that was written besides; empty for none.
        seconds: Time that the drive took.
        memory_mb: Most memory of the process so far.
    """

    place: str
    key: str
    stamp: str
    content: str
    output: str
    seconds: float
    memory_mb: float


@dataclass(frozen=True)
class Done:
    """A drive that is done.

    Attributes:
        stamp: As in `Header`, as are all but the last.
        content: See there.
        seconds: See there.
        memory_mb: See there.
        body: The result as JSON in one line.
    """

    stamp: str
    content: str
    seconds: float
    memory_mb: float
    body: str


@dataclass(frozen=True)
class Failed:
    """A drive that could not be done.

    Attributes:
        sentence: Why.
    """

    sentence: str


class Results:
    """Results in a folder. Several processes may write to it, each the drives of its own shard.

    Args:
        place: The folder.
        plan: What the results are of.
        suffix: As of `Work.suffix`.
    """

    def __init__(self, place: str, plan: Plan, suffix: str = "") -> None:
        self.plan, self._suffix = plan, suffix
        self.folder = folder_at(place)
        self._names: dict[str, str] = {}

    def begin(self) -> None:
        """Writes the plan, and looks at what is there.

        Raises:
            FleetError: when the folder has results of something else; FileError when it cannot be written.
        """
        there = read_plan(self.folder)
        if there is not None:
            _require_same(there, self.plan, self.folder.place)
        if there != self.plan:
            self.folder.write(PLAN, json.dumps(asdict(self.plan), indent=1).encode())
        self._look()

    def _look(self) -> None:
        files = (name for name in self.folder.names(_DRIVES) if name.endswith(_ENDING))
        self._names = {name.removesuffix(_ENDING).rpartition(".")[0]: name for name in files}

    def has(self, unit: Unit, stamp: str, content: Any) -> bool:
        """Whether a drive is done.

        Args:
            unit: The drive.
            stamp: Of its bag now.
            content: Called for the bag's content where its stamp is another one.
        """
        name = self._names.get(unit.name)
        header = None if name is None else self._header(name)
        if name is None or header is None:
            return False
        if header.output and header.output not in self.folder.names():
            return False
        known = header.content if header.stamp == stamp else content()
        if header.key == self._key(known):
            if (header.place, header.stamp) != (unit.place, stamp):
                found = self._read(name)
                if found is not None:
                    self._write(name, Header(**{**asdict(header), "place": unit.place, "stamp": stamp}), found[1])
            return True
        # Of a bag that is no more: it must not be taken for this one's.
        self.folder.remove(f"{_DRIVES}/{name}")
        del self._names[unit.name]
        return False

    def add(self, unit: Unit, outcome: Done | Failed) -> None:
        """Writes a drive's result, whole or not at all, or that it failed."""
        failure = f"{_FAILURES}/{unit.name}.json"
        if isinstance(outcome, Failed):
            self.folder.write(failure, (json.dumps({"drive": unit.place, "reason": outcome.sentence}) + "\n").encode())
            self._list_failures()
            return
        key, output = self._key(outcome.content), f"{unit.name}{self._suffix}" if self._suffix else ""
        header = Header(unit.place, key, outcome.stamp, outcome.content, output, outcome.seconds, outcome.memory_mb)
        name = f"{unit.name}.{key[:16]}{_ENDING}"
        self._write(f"{name}", header, outcome.body)
        self._names[unit.name] = name
        if self.folder.read(failure) is not None:
            self.folder.remove(failure)
            self._list_failures()

    def _key(self, content: str) -> str:
        return _sha256([self.plan.key, content])

    def _write(self, name: str, header: Header, body: str) -> None:
        lines = f"{json.dumps(asdict(header))}\n{body}\n"
        self.folder.write(f"{_DRIVES}/{name}", gzip.compress(lines.encode(), 1, mtime=0))

    def _read(self, name: str) -> tuple[Header, str] | None:
        """None for a file that is not a result: a drive without a result is done again."""
        content = self.folder.read(f"{_DRIVES}/{name}")
        if content is None:
            return None
        try:
            first, body, rest = gzip.decompress(content).decode().split("\n")
            return (Header(**json.loads(first)), body) if not rest else None
        except (OSError, EOFError, ValueError, TypeError):
            return None

    def _header(self, name: str) -> Header | None:
        found = self._read(name)
        return None if found is None else found[0]

    def result(self, unit: Unit) -> Mapping[str, Any] | None:
        """What a drive gave; None where it is not done."""
        found = self._read(self._names[unit.name]) if unit.name in self._names else None
        if found is None or found[0].key != self._key(found[0].content):
            return None
        values: Mapping[str, Any] = json.loads(found[1])
        return values

    def failures(self) -> dict[str, str]:
        """Why drives failed, by their place."""
        found = {}
        for name in sorted(self.folder.names(_FAILURES)):
            content = self.folder.read(f"{_FAILURES}/{name}")
            if content is not None:
                entry = json.loads(content)
                found[entry["drive"]] = entry["reason"]
        return found

    def _list_failures(self) -> None:
        """Writes the one file of all failures anew, one process after the other."""
        with _alone(self.folder.place):
            lines = (json.dumps({"drive": place, "reason": why}) + "\n" for place, why in self.failures().items())
            self.folder.write(FAILED, "".join(lines).encode())


def open_results(place: str) -> Results:
    """The results in a folder, for reading; FleetError where there is no plan."""
    plan = read_plan(folder_at(place))
    if plan is None:
        raise FleetError(
            f"there is no {PLAN} in {place}; give the folder that `radcam-depth evaluate BAGS --out` wrote to"
        )
    results = Results(place, plan)
    results._look()
    return results


def read_plan(folder: Folder) -> Plan | None:
    """A folder's plan, None where there is none; FleetError when it is damaged."""
    content = folder.read(PLAN)
    if content is None:
        return None
    try:
        values = json.loads(content)
        return Plan(**{**values, "drives": tuple(values["drives"])})
    except (ValueError, TypeError, KeyError) as error:
        raise FleetError(f"{folder.place}/{PLAN} is damaged ({error}); remove it, or choose another folder") from None


def _require_same(there: Plan, asked: Plan, place: str) -> None:
    if there.key == asked.key:
        return
    if there.verb != asked.verb:
        differing = f"of `radcam-depth {there.verb}`, not of `{asked.verb}`"
    elif there.version != asked.version:
        differing = f"of version {there.version} of this package, and this is {asked.version}"
    else:
        names = sorted(
            name for name in {*there.settings, *asked.settings} if there.settings.get(name) != asked.settings.get(name)
        )
        first = names[0]
        differing = (
            f"of other settings: {', '.join(names)} ({_shown(there.settings.get(first))}, now "
            f"{_shown(asked.settings.get(first))})"
        )
    raise FleetError(f"{place} holds results {differing}; choose another folder, or the same settings")


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _sha256(values: Any) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


@contextmanager
def _alone(place: str) -> Iterator[None]:
    """While this process alone writes; the lock is on the folder itself and goes with the process."""
    if not Path(place).is_dir():
        yield
        return
    handle = os.open(place, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
