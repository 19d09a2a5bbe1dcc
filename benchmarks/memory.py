"""Memory of a process, as Linux tells it."""

from __future__ import annotations

from pathlib import Path


def memory_mib(name: str, process: int | str = "self") -> float:
    """A figure of a process's memory (MiB), such as `VmRSS`."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(f"{name}:"))
