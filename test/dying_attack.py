"""An attack whose cases do what the package never should."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from benchmarks.adversary.cases import Outcome, Place

KEPT, MADE, TOLD, RAISED, KILLED, LEFT = range(6)


class DyingAttack:
    """Each case has a fault of its own; the good one is wrong after the last."""

    good_every = 100
    is_inside = True

    def __init__(self, seed: int, place: Place) -> None:
        self._place, self._number = place, -1

    def run(self, number: int) -> Outcome:
        self._number = number
        with self._place.watched() as problems:
            if number == MADE:
                Path("made").write_text("in the folder that the process is in", encoding="utf-8")
                Path("../bystander.txt").unlink()
            elif number == TOLD:
                print("Traceback (most recent call last):\n\x1b[2J")
            elif number == RAISED:
                raise KeyError("oh")
            elif number == KILLED:
                os.kill(os.getpid(), signal.SIGSEGV)
            elif number == LEFT:
                (self._place.folder.parent.parent / "elsewhere").write_text("outside", encoding="utf-8")
        return Outcome("a case", "done", tuple(problems))

    def good(self) -> tuple[str, ...]:
        return ("another depth",) if self._number == LEFT else ()

    def close(self) -> None:
        return
