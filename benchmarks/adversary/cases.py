"""Outcomes of cases, the folder that a case runs in, and what is judged of every case."""

from __future__ import annotations

import hashlib
import os
import random
import shutil
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from radcam_depth_ros import cli
from radcam_depth_ros.printable import printable

ROOT = Path(__file__).parents[2]
MOST_MIB = 1500.0
"""Resident memory that no case may exceed."""
DONE, REFUSED, SOME_FAILED = 0, 2, 3
"""Exit codes of all verbs."""
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_DEVICES = ("/dev/", "/proc/self/")


@dataclass(frozen=True)
class Outcome:
    """What a case gave.

    Attributes:
        what: What was done, for example `zip: truncated`.
        verdict: What became of it: `done`, `refused` and so on.
        problems: What should not have happened; none where the package held.
        peak_mib: Most resident memory of processes that the case started; 0 where it started none.
    """

    what: str
    verdict: str
    problems: tuple[str, ...] = ()
    peak_mib: float = 0.0


class Attack(Protocol):
    """Runs the cases of one kind.

    Attributes:
        good_every: So many cases come before a good one, whose result is compared.
        is_inside: Whether the package runs in this process, so that its limits hold for it.
    """

    good_every: int
    is_inside: bool

    def run(self, number: int) -> Outcome:
        """Runs a case, which its number and the seed make alone."""

    def good(self) -> tuple[str, ...]:
        """Gives the package what is good; returns what was wrong with its result."""

    def close(self) -> None:
        """Ends what was started."""


def generator(seed: int, kind: str, number: int) -> random.Random:
    """The random numbers of one case."""
    return random.Random(f"{seed}/{kind}/{number}")


class Place:
    """A folder for a worker: inputs, outputs, and bystanders that nobody may touch.

    Args:
        folder: A folder that is not there yet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.inputs, self.outputs = self.folder / "inputs", self.folder / "outputs"
        self.kept = self.folder / "kept"
        """For what cases share, such as good weights."""
        self._here, self._home, self._temporary = (self.folder / name for name in ("here", "home", "temporary"))
        self._caches = self.folder / "caches"
        self._told = self.folder / "told"
        self._written_elsewhere: list[str] = []
        for made in (self.inputs, self.outputs, self.kept, self._here, self._home, self._temporary, self._caches):
            made.mkdir(parents=True)
        for folder in (self._here, self._home, self.folder):
            (folder / "bystander.txt").write_text("nobody may touch this", encoding="utf-8")

    def enter(self) -> None:
        """Has this process work here: its folder, home, temporary files, and what it prints."""
        os.chdir(self._here)
        places = {"HOME": self._home, "XDG_CACHE_HOME": self._home, "TMPDIR": self._temporary, "PYTHONPATH": ROOT}
        os.environ.update({name: str(path) for name, path in places.items()})
        # torch and matplotlib keep what they compiled and found.
        os.environ.update(dict.fromkeys(("MPLCONFIGDIR", "TORCHINDUCTOR_CACHE_DIR"), str(self._caches)))
        os.environ.update(PYTHONDONTWRITEBYTECODE="1", COLUMNS="200")
        sys.dont_write_bytecode = True
        tempfile.tempdir = str(self._temporary)
        told = os.open(self._told, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        for descriptor in (1, 2):
            os.dup2(told, descriptor)
        sys.addaudithook(self._on_event)

    def clear(self) -> None:
        """Empties inputs and outputs."""
        for folder in (self.inputs, self.outputs):
            for path in folder.iterdir():
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                else:
                    path.unlink()

    @contextmanager
    def watched(self) -> Iterator[list[str]]:
        """Around what the package does: the list has what it should not have done, after the block."""
        problems: list[str] = []
        before = self._tree()
        self.told()
        self._written_elsewhere.clear()
        yield problems
        problems += _differences(before, self._tree())
        problems += [f"{path} was opened for writing" for path in dict.fromkeys(self._written_elsewhere)]
        problems += text_problems(self.told())

    def told(self) -> str:
        """What was printed since it was last asked for."""
        sys.stdout.flush()
        sys.stderr.flush()
        if not self._told.exists():
            return ""
        text = self._told.read_text(encoding="utf-8", errors="backslashreplace")
        os.truncate(self._told, 0)
        return text

    def left(self) -> list[str]:
        """Names of what is in the outputs."""
        # Unlike rglob, walk goes on where a verb removes a folder meanwhile.
        found = (Path(folder, name) for folder, folders, files in os.walk(self.outputs) for name in (*folders, *files))
        return sorted(str(path.relative_to(self.outputs)) for path in found)

    def _tree(self) -> dict[str, str]:
        """Everything but outputs, caches and what was printed: kind, size and hash of each."""
        return {
            name: entry
            for name, entry in tree(self.folder).items()
            if name != "told" and not name.startswith(("outputs/", "caches/"))
        }

    def _on_event(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str) or not (arguments[2] or 0) & _WRITING:
            return
        path = Path(arguments[0]).absolute()
        if not path.is_relative_to(self.folder) and not str(path).startswith(_DEVICES):
            self._written_elsewhere.append(str(path))


def tree(folder: Path) -> dict[str, str]:
    """Kind, size and hash of everything in a folder, by relative path."""
    entries = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            entry = f"link to {path.readlink()}"
        elif path.is_dir():
            entry = "folder"
        else:
            content = path.read_bytes()
            entry = f"{len(content)} bytes, {hashlib.sha256(content).hexdigest()}"
        entries[str(path.relative_to(folder))] = entry
    return entries


def _differences(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return [
        *(f"{printable(name)} was removed" for name in sorted(before.keys() - after.keys())),
        *(f"{printable(name)} was made" for name in sorted(after.keys() - before.keys())),
        *(f"{printable(name)} was changed" for name in before if name in after and before[name] != after[name]),
    ]


def text_problems(text: str) -> list[str]:
    """What nobody may find in the output of a verb or of the node: a traceback, control characters."""
    problems = []
    if "Traceback (most recent call last)" in text:
        problems.append(f"a traceback: {printable(text.strip().splitlines()[-1])[:300]}")
    strange = sorted({letter for letter in text if not letter.isprintable() and letter not in "\n\t"})
    if strange:
        problems.append(f"control characters in the output: {ascii(''.join(strange))[:80]}")
    return problems


def defect(error: BaseException) -> str:
    """An exception that is none of the package's own, with where it came from."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    inside = [entry for entry in traceback.extract_tb(error.__traceback__) if "radcam_depth_ros" in entry.filename]
    own = f", by {Path(inside[-1].filename).name}:{inside[-1].lineno}" if inside else ""
    text = printable(" ".join(str(error).split()))[:200]
    return f"{type(error).__name__}: {text} ({Path(place.filename).name}:{place.lineno}{own})"


def command(*arguments: object) -> int:
    """The exit code of `radcam-depth`, run in this process; what else than the exit it raises comes through."""
    sys.argv = ["radcam-depth", *(str(argument) for argument in arguments)]
    try:
        cli.main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return DONE


def attempt(problems: list[str], call: Callable[[], int], allowed: tuple[int, ...] = (DONE, REFUSED)) -> int | None:
    """A verb's exit code; None and a problem where it raised, and a problem for a code that is not documented."""
    try:
        code = call()
    except Exception as error:
        problems.append(f"a traceback: {defect(error)}")
        return None
    if code not in allowed:
        problems.append(f"exit code {code}, expected one of {', '.join(map(str, allowed))}")
    return code


def same(found: np.ndarray, expected: np.ndarray) -> bool:
    """Whether two results are equal but for rounding."""
    return found.shape == expected.shape and bool(np.allclose(found, expected, rtol=1e-3, atol=1e-3, equal_nan=True))
