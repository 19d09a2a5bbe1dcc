"""Work for tests: counts the bytes of a file, and notes each time that it does."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from radcam_depth_ros.fleet.errors import FleetError
from radcam_depth_ros.fleet.unit import Unit, Worker


@dataclass(frozen=True)
class Numbering:
    """Notes in `log` are a line for each drive that is done; a file that begins with `bad` is refused,
    and one with `die` ends its process."""

    log: str
    scale: int = 1
    seconds: float = 0.0

    verb: ClassVar[str] = "number"
    suffix: ClassVar[str] = ""
    reads_bags: ClassVar[bool] = True

    @property
    def threads(self) -> int:
        return 1

    def settings(self) -> dict[str, Any]:
        return {"scale": self.scale}

    def facts(self) -> dict[str, Any]:
        return {}

    def open(self) -> Worker:
        def work(unit: Unit, bag: Path, target: Path) -> Mapping[str, Any]:
            content = bag.read_bytes()
            if content.startswith(b"bad"):
                raise FleetError(f"expected a good drive in {bag}, got a bad one")
            if content.startswith(b"bug"):
                raise ZeroDivisionError("a bug")
            if content.startswith(b"die"):
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(self.seconds)
            with Path(self.log).open("a", encoding="utf-8") as log:
                log.write(f"{unit.name}\n")
            return {"value": self.scale * len(content)}

        return work
