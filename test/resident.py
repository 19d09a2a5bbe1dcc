"""Memory of this process."""

from __future__ import annotations

import os
from pathlib import Path


def resident_mib() -> float:
    """What the process has of the machine's memory (MiB), with what is free and only kept for later."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
